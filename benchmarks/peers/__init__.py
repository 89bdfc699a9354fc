# SPDX-License-Identifier: MIT
"""Compares physim-drake with other packages on the same clouds and images.

make peers
build/peers/bin/python -m benchmarks.peers [--dataset DIR] [--json FILE]

The other packages live in their own environment, `build/peers`, which sees that of the
project but does not change it. A missing package is named and left out.
"""
