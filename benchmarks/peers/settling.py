# SPDX-License-Identifier: MIT
"""Ways to let one object come to rest among others that stay where they are.

Each engine gets the same convex pieces, masses and starts. The time does not include
building a scene, which an engine keeps for all poses that are tried.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.peers.cases import Case
from benchmarks.peers.installed import installed
from physim_drake.objects.model import ObjectModel
from physim_drake.physics.depenetration import depenetrate
from physim_drake.physics.settling import SettleConfig, Settler
from physim_drake.poses import Array, inverse, make_pose, rotation_angle

Others = Sequence[tuple[ObjectModel, Array]]
"""The objects that stay, with their X_SO."""


class Engine(Protocol):
    """A method of settling.

    Attributes:
        name: name of the method.
    """

    name: str

    def build(self, case: Case, others: Others) -> Any:
        """Makes a scene with the case's object free."""

    def settle(self, scene: Any, X_SO: Array) -> Array:
        """Lets the object go at X_SO (4, 4) and returns its pose at rest."""


def engines() -> list[Engine]:
    """The engines that can be used, ours first."""
    found: list[Engine] = [Ours(), OursFreed()]
    if installed("mujoco"):
        found.append(MujocoEngine())
    if installed("pybullet"):
        found.append(PybulletEngine())
    return found


class Ours:
    """Hydroelastic contact in Drake."""

    name = "physim-drake"

    def build(self, case: Case, others: Others) -> Any:
        """A plant with a slot for every other object."""
        settler = Settler(case.model, [model for model, _ in others])
        return settler, dict(enumerate(X for _, X in others))

    def settle(self, scene: Any, X_SO: Array) -> Array:
        """Until it rests, or 0.8 s."""
        settler, placed = scene
        return np.asarray(settler.settle(X_SO, placed).X_SO)


class OursFreed(Ours):
    """The same after overlap was taken away at rest, as the search does it."""

    name = "physim-drake, pushed apart first"

    def build(self, case: Case, others: Others) -> Any:
        """As before."""
        return super().build(case, others), case.model, others

    def settle(self, scene: Any, X_SO: Array) -> Array:
        """As before."""
        inner, model, others = scene
        return super().settle(inner, depenetrate(model, X_SO, others))


class MujocoEngine:
    """MuJoCo's soft contact, damped and stopped as ours is."""

    name = "MuJoCo"
    _STEP = 0.002  # s, its default

    def build(self, case: Case, others: Others) -> Any:
        """A model whose other bodies have no joint."""
        import mujoco

        config = SettleConfig()
        spec = mujoco.MjSpec()
        spec.option.timestep = self._STEP
        spec.option.gravity = [0.0, 0.0, -config.gravity]
        plane = spec.worldbody.add_geom()
        plane.type, plane.size = mujoco.mjtGeom.mjGEOM_PLANE, [2.0, 2.0, 0.1]
        plane.friction = [0.8, 0.005, 0.0001]
        poses = [(case.model, np.eye(4)), *others]
        for n, (model, X_SO) in enumerate(poses):
            body = spec.worldbody.add_body()
            body.name, body.pos, body.quat = f"body_{n}", X_SO[:3, 3], _wxyz(X_SO)
            if n == 0:
                body.add_freejoint()
            _give_mass(body, model)
            for k, piece in enumerate(model.collision_pieces):
                mesh = spec.add_mesh()
                mesh.name = f"piece_{n}_{k}"
                mesh.uservert = np.asarray(piece.vertices, dtype=np.float32).ravel()
                mesh.userface = np.asarray(piece.faces, dtype=np.int32).ravel()
                geom = body.add_geom()
                geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh.name
                geom.friction = [model.friction, 0.005, 0.0001]
        compiled = spec.compile()
        moment = float(np.trace(case.model.inertia)) / 3
        compiled.dof_damping[:3] = case.model.mass / config.damping_time
        compiled.dof_damping[3:6] = moment / config.damping_time
        return compiled, mujoco.MjData(compiled), case.model.diameter / 2

    def settle(self, scene: Any, X_SO: Array) -> Array:
        """Until it rests, or 0.8 s."""
        import mujoco

        config = SettleConfig()
        model, data, radius = scene
        mujoco.mj_resetData(model, data)
        data.qpos[:3], data.qpos[3:7] = X_SO[:3, 3], _wxyz(X_SO)
        duration = config.rest_steps * config.time_step
        last = X_SO
        for _ in range(math.ceil(config.max_time / duration)):
            mujoco.mj_step(model, data, round(duration / self._STEP))
            R = Rotation.from_quat(data.qpos[3:7], scalar_first=True).as_matrix()
            pose = make_pose(R, data.qpos[:3])
            turn = float(rotation_angle(last[:3, :3].T @ R))
            travel = max(math.dist(last[:3, 3], pose[:3, 3]), turn * radius)
            last = pose
            if travel < config.rest_speed * duration:
                break
        return last


class PybulletEngine:
    """Bullet with the parameters of the paper's implementation.

    Convex hulls with a margin of 1 mm, friction 1, damping 0.99, 2 m/s^2 of gravity,
    60 steps of 1/60 s.
    """

    name = "PyBullet"

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()

    def build(self, case: Case, others: Others) -> Any:
        """A world whose other bodies have no mass."""
        import pybullet as bullet
        from pybullet_utils.bullet_client import BulletClient

        world = BulletClient(bullet.DIRECT)
        world.setGravity(0, 0, -2.0)
        world.setTimeStep(1 / 60)
        plane = world.createCollisionShape(bullet.GEOM_PLANE)
        world.changeDynamics(world.createMultiBody(0, plane), -1, lateralFriction=1)
        free, X_OI = self._add(world, case.model, case.model.mass)
        for model, X_SO in others:
            fixed, X_PI = self._add(world, model, 0.0)
            _place(world, fixed, X_SO @ X_PI)
        return world, free, X_OI

    def settle(self, scene: Any, X_SO: Array) -> Array:
        """One second."""
        world, free, X_OI = scene
        _place(world, free, X_SO @ X_OI)
        world.resetBaseVelocity(free, [0, 0, 0], [0, 0, 0])
        for _ in range(60):
            world.stepSimulation()
        position, quaternion = world.getBasePositionAndOrientation(free)
        R = Rotation.from_quat(quaternion).as_matrix()
        return make_pose(R, position) @ inverse(X_OI)

    def _add(self, world: Any, model: ObjectModel, mass: float) -> tuple[int, Array]:
        """A body, and the pose X_OI of its centre of mass and principal axes."""
        moments, axes = np.linalg.eigh(model.inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        X_OI = make_pose(axes, model.center_of_mass)
        path = Path(self._folder.name) / f"{model.name}.obj"
        if not path.exists():
            path.write_text(_obj(model))
        shape = world.createCollisionShape(world.GEOM_MESH, fileName=str(path))
        body = world.createMultiBody(
            mass,
            shape,
            baseInertialFramePosition=X_OI[:3, 3].tolist(),
            baseInertialFrameOrientation=Rotation.from_matrix(axes).as_quat().tolist(),
        )
        world.changeDynamics(
            body,
            -1,
            lateralFriction=1,
            restitution=0,
            linearDamping=0.99,
            angularDamping=0.99,
            collisionMargin=0.001,
            **({"localInertiaDiagonal": moments.tolist()} if mass else {}),
        )
        return body, X_OI


def _place(world: Any, body: int, X_SI: Array) -> None:
    quaternion = Rotation.from_matrix(X_SI[:3, :3]).as_quat()
    world.resetBasePositionAndOrientation(body, X_SI[:3, 3].tolist(), quaternion)


def _give_mass(body: Any, model: ObjectModel) -> None:
    inertia = model.inertia
    body.mass, body.ipos = model.mass, model.center_of_mass
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    body.fullinertia = inertia[rows, columns]
    body.explicitinertial = True


def _wxyz(X: Array) -> Array:
    return np.asarray(Rotation.from_matrix(X[:3, :3]).as_quat(scalar_first=True))


def _obj(model: ObjectModel) -> str:
    """The pieces as objects of one OBJ, of each of which Bullet takes the hull."""
    lines, offset = [], 1
    for n, piece in enumerate(model.collision_pieces):
        lines.append(f"o piece_{n}")
        lines += [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in piece.vertices]
        lines += [
            f"f {a + offset} {b + offset} {c + offset}" for a, b, c in piece.faces
        ]
        offset += len(piece.vertices)
    return "\n".join(lines) + "\n"
