# SPDX-License-Identifier: MIT
"""Episodes of the pick cell: run, judged by the truth, kept, resumed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
