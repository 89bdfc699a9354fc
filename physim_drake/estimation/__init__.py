# SPDX-License-Identifier: MIT
"""One observation in, the poses of all its objects out."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
