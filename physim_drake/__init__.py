# SPDX-License-Identifier: MIT
"""Estimates the poses of all known objects in one RGB-D image at once.

``import physim_drake as physim`` loads nothing else; each name loads when it is first
used::

    library = physim.ObjectLibrary.load("my_meshes")
    observation = physim.RgbdObservation(depth, intrinsics, color)
    estimate = physim.estimate_scene(observation, library, detections)
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
