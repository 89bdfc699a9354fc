# SPDX-License-Identifier: MIT
"""Depth images of objects and scenes."""
