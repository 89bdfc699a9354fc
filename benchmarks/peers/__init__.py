# SPDX-License-Identifier: MIT
"""physim-drake beside what else could be used, on the same clouds and images.

make peers
build/peers/bin/python -m benchmarks.peers [--dataset DIR] [--json FILE]

The other packages live in an environment of their own, `build/peers`, which sees that
of the project but changes nothing in it. One that is missing is named and left out.
"""
