# SPDX-License-Identifier: MIT
"""Faster R-CNN and FCN in plain torch, and their weights."""
