# SPDX-License-Identifier: MIT
"""Pose hypotheses for one object at a time."""
