# SPDX-License-Identifier: MIT
"""Which of the other packages are installed."""

from __future__ import annotations

from importlib.util import find_spec

HOW = "make peers, then build/peers/bin/python -m benchmarks.peers"

PACKAGES = {
    "open3d": "Open3D",
    "ppf_match_3d": "OpenCV's contributed modules (PPF surface matching)",
    "small_gicp": "small_gicp",
    "mujoco": "MuJoCo",
    "pybullet": "PyBullet",
}


def installed(package: str) -> bool:
    """Whether one of `PACKAGES` can be used."""
    if package == "ppf_match_3d":
        import cv2

        return hasattr(cv2, "ppf_match_3d")
    return find_spec(package) is not None


def missing() -> list[str]:
    """The names of the packages that cannot be used."""
    return [name for package, name in PACKAGES.items() if not installed(package)]
