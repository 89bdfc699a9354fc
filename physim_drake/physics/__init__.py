# SPDX-License-Identifier: MIT
"""Settling objects with MultibodyPlant."""
