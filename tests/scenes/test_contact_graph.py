# SPDX-License-Identifier: MIT
from __future__ import annotations

from physim_drake.scenes.contact_graph import (
    contact_edges,
    interaction_levels,
    largest_group,
)


def test_level_is_the_size_of_the_component():
    assert interaction_levels(4, []) == (1, 1, 1, 1)
    assert interaction_levels(4, [(0, 2)]) == (2, 1, 2, 1)
    assert interaction_levels(4, [(0, 2), (2, 3)]) == (3, 1, 3, 3)


def test_level_is_at_most_three():
    assert interaction_levels(5, [(0, 1), (1, 2), (2, 3)]) == (3, 3, 3, 3, 1)


def test_edges_are_the_near_pairs_in_order():
    distances = {(2, 1): 1e-4, (0, 1): -3e-4, (0, 2): 3e-4}
    assert contact_edges(distances, 2e-4) == ((0, 1), (1, 2))


def test_largest_group():
    assert largest_group(3, []) == 1
    assert largest_group(6, [(0, 1), (5, 2), (2, 4)]) == 3
