# SPDX-License-Identifier: MIT
"""The known objects: models, files, meshes, convex pieces, symmetry."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
