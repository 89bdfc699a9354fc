# SPDX-License-Identifier: MIT
"""A vacuum cup: when it seals, what it holds, what it touches with."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
