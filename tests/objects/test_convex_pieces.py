# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from physim_drake.objects import convex_pieces as collision
from physim_drake.objects.convex_pieces import (
    convex_pieces,
    pieces_deviation,
    simplify_hull,
)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path


@pytest.fixture
def ring() -> trimesh.Trimesh:
    return trimesh.creation.annulus(0.03, 0.05, 0.04, sections=24)


def test_a_finely_meshed_box_is_one_piece_of_twelve_faces() -> None:
    mesh = trimesh.creation.box((0.05, 0.1, 0.02)).subdivide().subdivide()
    (piece,) = convex_pieces(mesh)
    assert len(piece.faces) == 12
    assert piece.volume == pytest.approx(0.05 * 0.1 * 0.02)


def test_simplified_hulls_keep_within_a_millimetre() -> None:
    for mesh in (
        trimesh.creation.icosphere(4, 0.035),
        trimesh.creation.cylinder(0.05, 0.14, sections=200),
        trimesh.creation.capsule(0.1, 0.015),
    ):
        hull = mesh.convex_hull
        piece = simplify_hull(hull, 60)
        assert piece.is_watertight
        assert len(piece.faces) < len(hull.faces)
        planes = ConvexHull(piece.vertices).equations
        outside = hull.vertices @ planes[:, :3].T + planes[:, 3]
        assert outside.max() < 1e-3


def test_a_ring_keeps_its_hole(ring: trimesh.Trimesh) -> None:
    pieces = convex_pieces(ring)
    assert len(pieces) > 3
    assert all(piece.is_watertight for piece in pieces)
    middle = np.zeros((1, 3))
    assert not any(piece.contains(middle)[0] for piece in pieces)
    assert pieces_deviation(pieces, ring) < 0.006


def test_deviation_of_a_hull_over_a_ring(ring: trimesh.Trimesh) -> None:
    # The middle of the top of the hull is an inner radius away from the ring; random
    # points come within a few millimetres of it.
    deviation = pieces_deviation((ring.convex_hull,), ring)
    assert deviation == pytest.approx(0.03, abs=0.005)


def test_decompositions_are_kept(
    ring: trimesh.Trimesh, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = convex_pieces(ring)
    (kept,) = (cache / "physim-drake" / "convex").iterdir()
    assert kept.suffix == ".npz"
    original = collision._decompose
    monkeypatch.setattr(collision, "_decompose", None)
    for one, other in zip(first, convex_pieces(ring), strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
    monkeypatch.setattr(collision, "_decompose", original)
    kept.write_bytes(b"damaged")
    assert len(convex_pieces(ring)) == len(first)


def test_works_without_a_cache(
    ring: trimesh.Trimesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert len(convex_pieces(ring)) > 3
