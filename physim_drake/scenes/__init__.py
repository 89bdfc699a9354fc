# SPDX-License-Identifier: MIT
"""Cluttered scenes with exact ground truth: placed, settled, labelled, looked at."""
