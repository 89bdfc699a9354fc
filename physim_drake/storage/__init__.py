# SPDX-License-Identifier: MIT
"""Writes files whole, and reads them with errors that name the place."""
