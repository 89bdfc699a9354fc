# SPDX-License-Identifier: MIT
"""Reading and writing BOP datasets and results."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
