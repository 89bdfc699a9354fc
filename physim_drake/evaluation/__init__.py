# SPDX-License-Identifier: MIT
"""Error measures and their tables."""
