# SPDX-License-Identifier: MIT
"""Settings of generated scenes."""

from __future__ import annotations

from dataclasses import dataclass

from physim_drake.objects.containers import ContainerName


@dataclass(frozen=True)
class RestLimits:
    """Limits within which a scene is at rest.

    Attributes:
        speed: greatest speed of an object's origin and centre of mass, m/s.
        angular_speed: greatest angular speed, rad/s.
        penetration: greatest penetration of any two bodies, m.
        drift: greatest distance that an object moves while the scene is held, m.
        drift_angle: greatest angle by which it turns meanwhile, rad.
    """

    speed: float = 1e-3
    angular_speed: float = 1e-2
    penetration: float = 1e-3
    drift: float = 1e-3
    drift_angle: float = 0.01


@dataclass(frozen=True)
class SettlingConfig:
    """Settings of the settling of a scene.

    Attributes:
        time_step: time step of the discrete contact solver, s. Longer ones throw
            objects that stand on a flat face.
        damping_time: time constant with which motion dies away at first, s.
        max_time: longest time of damped settling, s.
        hold_time: time for which the scene is then held without damping, s.
        touching: greatest distance of objects in contact, m.
        apart: least distance of objects that are not in contact, m. Scenes with a
            pair in between are rejected, since their level would be ambiguous.
        limits: limits within which the scene is at rest.
    """

    time_step: float = 0.005
    damping_time: float = 0.1
    max_time: float = 2.0
    hold_time: float = 0.5
    touching: float = 2e-4
    apart: float = 2e-3
    limits: RestLimits = RestLimits()


@dataclass(frozen=True)
class SceneConfig:
    """Settings of one scene.

    Attributes:
        level: highest interaction level in the scene, 1 to 3; a larger number asks for
            a pile of that many objects, a few of which may roll off.
        min_objects: least number of objects.
        max_objects: greatest number of objects.
        container: support of the objects.
        max_tries: greatest number of scenes that are drawn until one settles as asked.
        settling: settings of the settling.
        repeats: True if objects may occur again once the whole library is in the
            scene; otherwise `max_objects` is limited by the size of the library.
    """

    level: int = 1
    min_objects: int = 2
    max_objects: int = 4
    container: ContainerName = ContainerName.TABLE
    max_tries: int = 100
    settling: SettlingConfig = SettlingConfig()
    repeats: bool = False
