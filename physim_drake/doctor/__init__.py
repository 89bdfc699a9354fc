# SPDX-License-Identifier: MIT
"""Checks whether this installation works, and says how to repair it."""
