# SPDX-License-Identifier: MIT
"""What can be set about generated scenes."""

from __future__ import annotations

from dataclasses import dataclass

from physim_drake.objects.containers import ContainerName


@dataclass(frozen=True)
class RestLimits:
    """What counts as a scene at rest.

    Attributes:
        speed: of an object's origin and its centre of mass, m/s.
        angular_speed: rad/s.
        penetration: of any two bodies, m.
        drift: an object may move this far while the scene is left alone, m.
        drift_angle: and turn by this much, rad.
    """

    speed: float = 1e-3
    angular_speed: float = 1e-2
    penetration: float = 1e-3
    drift: float = 1e-3
    drift_angle: float = 0.01


@dataclass(frozen=True)
class SettlingConfig:
    """How a whole scene comes to rest.

    Attributes:
        time_step: of the discrete contact solver, s. Longer ones throw objects that
            stand on a flat face.
        damping_time: motion dies away with this time constant at first, s.
        max_time: of damped settling, s.
        hold_time: then the scene is left alone, without damping, s.
        touching: objects no farther apart than this are in contact, m.
        apart: and those at least this far apart are not; scenes with a pair in
            between are rejected, since their level would be a matter of taste, m.
        limits: what counts as rest.
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
    """One scene to generate.

    Attributes:
        level: the highest interaction level in the scene, 1 to 3; a larger number
            asks for a pile of so many objects, a few of which may roll off.
        min_objects: fewest objects.
        max_objects: most objects.
        container: what they stand on or in.
        max_tries: a scene that does not settle as asked is drawn again, this often.
        settling: how it comes to rest.
        repeats: objects occur again once all of the library are in the scene; without
            it, no more can be asked for than there are.
    """

    level: int = 1
    min_objects: int = 2
    max_objects: int = 4
    container: ContainerName = ContainerName.TABLE
    max_tries: int = 100
    settling: SettlingConfig = SettlingConfig()
    repeats: bool = False
