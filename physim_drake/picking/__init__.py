# SPDX-License-Identifier: MIT
"""Picking objects one by one, planned on an estimated scene."""
