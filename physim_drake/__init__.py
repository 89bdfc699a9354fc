# SPDX-License-Identifier: MIT
"""Estimates the poses of all known objects in one RGB-D image at once."""

__version__ = "0.1.0"
