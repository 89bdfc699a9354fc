# SPDX-License-Identifier: MIT
"""Many images: estimated one by one, resumable, local or on Ray."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
