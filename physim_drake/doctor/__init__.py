# SPDX-License-Identifier: MIT
"""Whether this installation works, and what to do if not."""
