# SPDX-License-Identifier: MIT
"""Registration of a shape to points: distance field, trimmed ICP, LCP."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
