# SPDX-License-Identifier: MIT
"""Picking objects one by one, planned on an estimated scene."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
