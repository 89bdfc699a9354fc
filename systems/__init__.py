# SPDX-License-Identifier: MIT
"""Drake systems over the algorithms of physim_drake."""
