# SPDX-License-Identifier: MIT
"""Reading and writing BOP datasets and results."""
