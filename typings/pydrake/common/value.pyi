# SPDX-License-Identifier: MIT
# Any: the stub that pydrake brings lacks Value, which is a template.
from typing import Any

def __getattr__(name: str) -> Any: ...
