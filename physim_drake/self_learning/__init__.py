# SPDX-License-Identifier: MIT
"""Labels for what a detector missed, from what it saw from elsewhere."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
