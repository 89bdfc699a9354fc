# SPDX-License-Identifier: MIT
"""One look at a scene: images, detections, support surface, segments."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
