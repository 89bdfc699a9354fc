# SPDX-License-Identifier: MIT
"""Files: written whole, read with errors that name the place."""
