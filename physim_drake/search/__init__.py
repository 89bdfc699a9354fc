# SPDX-License-Identifier: MIT
"""The search for the joint poses that explain the image."""
