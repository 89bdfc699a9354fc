# SPDX-License-Identifier: MIT
# Any: pydrake brings a stub that writes a float64 array as ndarray[float64], a shape.
from typing import Any

def __getattr__(name: str) -> Any: ...
