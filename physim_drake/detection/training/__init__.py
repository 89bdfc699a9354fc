# SPDX-License-Identifier: MIT
"""Training detectors on generated scenes."""
