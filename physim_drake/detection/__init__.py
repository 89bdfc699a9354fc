# SPDX-License-Identifier: MIT
"""Networks that find the known objects in an image, and their training."""
