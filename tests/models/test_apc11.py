# SPDX-License-Identifier: MIT
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from pydrake.geometry import HalfSpace
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlantConfig,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from physim_drake.models import APC11, DETECTOR
from physim_drake.models.apc11_objects import all_objects
from physim_drake.models.make_apc11 import make_models
from physim_drake.objects.library_files import find_objects
from physim_drake.objects.model import ObjectLibrary, ObjectModel

EXTENTS = {
    "crayola_24_ct": (0.022, 0.095, 0.071),
    "expo_dry_erase_board_eraser": (0.055, 0.130, 0.035),
    "folgers_classic_roast_coffee": (0.104, 0.140, 0.104),
    "scotch_duct_tape": (0.096, 0.049, 0.096),
    "up_glucose_bottle": (0.070, 0.140, 0.070),
    "laugh_out_loud_joke_book": (0.010, 0.178, 0.108),
    "soft_white_lightbulb": (0.062, 0.120, 0.064),
    "kleenex_tissue_box": (0.128, 0.110, 0.112),
    "dove_beauty_bar": (0.037, 0.065, 0.091),
    "elmers_washable_no_run_school_glue": (0.064, 0.145, 0.030),
    "rawlings_baseball": (0.070, 0.070, 0.070),
}
TOLERANCE = 1e-3  # m, between what is seen and what touches

each_object = pytest.mark.parametrize("name", EXTENTS)


@pytest.fixture(scope="module")
def library() -> ObjectLibrary:
    return ObjectLibrary.load(APC11)


def distance_to(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Distances (N,) of points to the surface of a mesh, without an index."""
    best = np.full(len(points), np.inf)
    triangles = mesh.triangles.view(np.ndarray)
    for block in np.array_split(np.arange(len(triangles)), len(triangles) // 200 + 1):
        pairs = np.repeat(triangles[block], len(points), axis=0)
        tiled = np.tile(points, (len(block), 1))
        closest = trimesh.triangles.closest_point(pairs, tiled)
        gap = np.linalg.norm(closest - tiled, axis=1).reshape(len(block), -1)
        best = np.minimum(best, gap.min(axis=0))
    return best


def inside(piece: trimesh.Trimesh, points: np.ndarray, margin: float) -> np.ndarray:
    """Whether points are deeper than `-margin` in a convex piece."""
    heights = (points @ piece.face_normals.T) - np.einsum(
        "ij,ij->i", piece.face_normals, piece.triangles[:, 0]
    )
    return heights.max(axis=1) < margin


def outer_samples(
    pieces: tuple[trimesh.Trimesh, ...], count: int, seed: int
) -> np.ndarray:
    """Points on the surface of a union of convex pieces."""
    samples = []
    for k, piece in enumerate(pieces):
        points = trimesh.sample.sample_surface(piece, count, seed=seed)[0]
        hidden = np.zeros(len(points), dtype=bool)
        for j, other in enumerate(pieces):
            if j != k:
                hidden |= inside(other, points, 1e-5)
        samples.append(points[~hidden])
    return np.concatenate(samples)


def deviations(model: ObjectModel) -> tuple[float, float]:
    """Greatest distances, m, from visual to collision surface and back."""
    pieces = model.collision_pieces
    seen = np.concatenate(
        [
            trimesh.sample.sample_surface(model.mesh, 1500, seed=0)[0],
            model.mesh.vertices[::7],
        ]
    )
    merged = trimesh.util.concatenate(list(pieces))
    there = distance_to(merged, seen).max()
    touching = outer_samples(pieces, 1500 // len(pieces), seed=1)
    back = distance_to(model.mesh, touching).max()
    return float(there), float(back)


def dropped(name: str, R_WO: RotationMatrix, height: float) -> np.ndarray:
    """Heights of O, m, over one second after letting an object go above the ground."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=0.002, discrete_contact_approximation="lagged"
    )
    plant, _ = AddMultibodyPlant(config, builder)
    plant.RegisterCollisionGeometry(
        plant.world_body(),
        RigidTransform(),
        HalfSpace(),
        "ground",
        CoulombFriction(0.8, 0.8),
    )
    (instance,) = Parser(plant).AddModels(str(APC11 / name / f"{name}.sdf"))
    plant.Finalize()
    body = plant.get_body(plant.GetBodyIndices(instance)[0])
    plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform(R_WO, [0, 0, height]))
    simulator = Simulator(builder.Build())
    context = plant.GetMyContextFromRoot(simulator.get_context())
    heights = []
    for time in np.linspace(0, 1, 21):
        simulator.AdvanceTo(time)
        heights.append(body.EvalPoseInWorld(context).translation()[2])
    return np.array(heights)


def numbers(path: Path) -> list[float]:
    """The inertial values of an SDF file."""
    inertial = ET.parse(path).getroot().find(".//inertial")
    assert inertial is not None
    return [float(x) for text in inertial.itertext() for x in text.split()]


def test_library_has_the_objects_of_the_table(library):
    assert [library[i].name for i in library.ids] == list(EXTENTS)
    assert library.ids == tuple(range(1, 12))
    assert not any(model.problems for model in library.values())


@each_object
def test_extents_are_those_of_the_table_about_the_origin(library, name):
    low, high = library.by_name(name).mesh.bounds
    np.testing.assert_allclose(high - low, EXTENTS[name], atol=1e-4)
    np.testing.assert_allclose(low + high, 0, atol=1e-4)


@each_object
def test_surface_is_closed_and_faces_outward(library, name):
    mesh = library.by_name(name).mesh
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert len(mesh.faces) <= 7000


@each_object
def test_normals_of_the_file_agree_with_its_faces(name):
    mesh = trimesh.load(APC11 / name / f"{name}.obj", process=False)
    corners = mesh.vertex_normals[mesh.faces]
    along = np.einsum("fcj,fj->fc", corners, mesh.face_normals)
    assert along.min() > np.cos(np.radians(60))


@each_object
def test_collision_agrees_with_the_visual_both_ways(library, name):
    model = library.by_name(name)
    there, back = deviations(model)
    assert there < TOLERANCE
    assert back < TOLERANCE


@each_object
def test_symmetries_map_the_surface_onto_itself(library, name):
    model = library.by_name(name)
    points = trimesh.sample.sample_surface(model.mesh, 150, seed=2)[0]
    # The near squares of two boxes differ by 1 mm on each side.
    for X in model.symmetry.sampled(7)[:30]:
        moved = points @ X[:3, :3].T + X[:3, 3]
        assert distance_to(model.mesh, moved).max() < 1.5e-3


def test_can_and_bottle_cannot_be_turned_over(library):
    for name in ("folgers_classic_roast_coffee", "up_glucose_bottle"):
        mesh = library.by_name(name).mesh
        points = trimesh.sample.sample_surface(mesh, 500, seed=3)[0]
        assert distance_to(mesh, points * [1, -1, -1]).max() > TOLERANCE


def test_hole_of_the_tape_stays_open(library):
    pieces = library.by_name("scotch_duct_tape").collision_pieces
    y = np.linspace(-0.03, 0.03, 13)
    axis = np.stack([0 * y, y, 0 * y], axis=1)
    for offset in ([0, 0, 0], [0.037, 0, 0], [0.026, 0, 0.026]):
        for piece in pieces:
            assert not inside(piece, axis + offset, 0.0).any()


@each_object
def test_texture_is_used_and_each_object_has_its_own(library, name):
    path = library.by_name(name).texture
    assert path is not None
    image = np.asarray(Image.open(path).convert("RGB"))
    mesh = trimesh.load(APC11 / name / f"{name}.obj", process=False)
    uv = mesh.visual.uv
    assert uv.min() >= 0
    assert uv.max() <= 1
    pixels = (uv * [512, -512] + [0, 512]).astype(int).clip(0, 511)
    assert len(np.unique(image[pixels[:, 1], pixels[:, 0]], axis=0)) > 1
    others = [p for p in APC11.glob("*/*.png") if p != path]
    assert all(p.read_bytes() != path.read_bytes() for p in others)


@each_object
def test_sdf_gives_drake_the_mass_and_one_convex_shape_a_piece(library, name):
    model = library.by_name(name)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(), builder)
    (instance,) = Parser(plant).AddModels(str(APC11 / name / f"{name}.sdf"))
    plant.Finalize()
    body = plant.get_body(plant.GetBodyIndices(instance)[0])
    assert body.default_mass() == pytest.approx(model.mass)
    shapes = plant.GetCollisionGeometriesForBody(body)
    assert len(shapes) == len(model.collision_pieces)
    inspector = scene_graph.model_inspector()
    for shape in shapes:
        properties = inspector.GetProximityProperties(shape)
        modulus = properties.GetProperty("hydroelastic", "hydroelastic_modulus")
        assert modulus == pytest.approx(1e7)


@pytest.mark.parametrize(
    "name",
    ["dove_beauty_bar", "folgers_classic_roast_coffee", "scotch_duct_tape"],
)
def test_object_comes_to_rest_on_the_ground_without_sinking(name):
    height = EXTENTS[name][1] / 2
    heights = dropped(name, RotationMatrix.MakeXRotation(np.pi / 2), height + 1e-4)
    assert abs(heights[-1] - height) < 5e-4
    assert all(abs(b - a) < 1e-4 for a, b in pairwise(heights[-4:]))


@pytest.mark.parametrize("name", ["crayola_24_ct", "scotch_duct_tape"])
def test_program_makes_the_files_that_are_here(tmp_path: Path, name):
    make_models(tmp_path, [name])
    made = sorted(path.name for path in (tmp_path / name).iterdir())
    assert made == sorted(path.name for path in (APC11 / name).iterdir())
    for path in (tmp_path / name).iterdir():
        here = APC11 / name / path.name
        if path.suffix == ".png":
            # The packing of a PNG is left to the library that writes it.
            np.testing.assert_array_equal(Image.open(path), Image.open(here))
        elif path.suffix == ".sdf":
            # The inertia's last digits are the processor's.
            assert numbers(path) == pytest.approx(numbers(here), rel=1e-6, abs=1e-9)
        else:
            assert path.read_bytes() == here.read_bytes()


def test_folder_is_small_and_complete():
    files = [path for path in APC11.rglob("*") if path.is_file()]
    weights = DETECTOR.stat().st_size
    assert sum(path.stat().st_size for path in files) - weights < 6e6
    assert weights < 25e6
    listed = {piece for entry in find_objects(APC11) for piece in entry.collision}
    assert listed == set(APC11.glob("*/*_collision_*.obj"))


def test_specs_agree_with_the_table():
    assert {spec.name: spec.extents for spec in all_objects()} == EXTENTS
