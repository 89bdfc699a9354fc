# SPDX-License-Identifier: MIT
"""Generates cluttered scenes with exact ground truth, and images of them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
