# SPDX-License-Identifier: MIT
"""Object sets that come with physim-drake."""
