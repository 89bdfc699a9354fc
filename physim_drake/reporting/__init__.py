# SPDX-License-Identifier: MIT
"""The paper's tables and figures for any dataset, as one page."""
