# SPDX-License-Identifier: MIT
"""Cluttered scenes with exact ground truth: placed, settled, labelled, looked at."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
