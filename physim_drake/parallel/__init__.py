# SPDX-License-Identifier: MIT
"""Processes: a supervised pool, Ray, log levels."""
