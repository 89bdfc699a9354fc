# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np

from physim_drake.picking.piles import objects_on
from physim_drake.picking.surroundings import placed_objects
from physim_drake.poses import make_pose
from tests.picking.scenes import estimate_of, lifted
from tests.synthetic import (
    BOOK,
    SOAP,
    TISSUES,
    Objects,
    library,
    pair_apart,
    resting,
    stack,
    turned,
)

FLAT = turned("y", 90)
"""Lays book and soap on their wide faces."""


def above(objects: Objects) -> dict[int, set[int]]:
    found = objects_on(placed_objects(estimate_of(objects), library()))
    return {index: set(on) for index, on in found.items()}


def test_what_stands_alone_has_nothing_on_it() -> None:
    assert above(pair_apart()) == {0: set(), 1: set()}


def test_the_lower_of_two_has_the_upper_on_it() -> None:
    assert above(stack()) == {0: {1}, 1: set()}


def test_estimates_may_gap_or_overlap_by_millimetres() -> None:
    lower, (upper_id, X) = stack()
    for error in (0.002, -0.003):
        assert above((lower, (upper_id, lifted(X, error)))) == {0: {1}, 1: set()}


def test_what_lies_on_a_thing_on_a_thing_counts() -> None:
    book = resting(BOOK, FLAT, 0.0, 0.0)
    height = float(library()[BOOK].extents[0])
    soap = resting(SOAP, FLAT, 0.0, 0.0, height)
    height += float(library()[SOAP].extents[0])
    box = resting(TISSUES, np.eye(3), 0.0, 0.0, height)
    pile = ((BOOK, book), (SOAP, soap), (TISSUES, box))
    assert above(pile) == {0: {1, 2}, 1: {2}, 2: set()}
    assert above(pile[::-1]) == {2: {0, 1}, 1: {0}, 0: set()}


def test_neighbours_that_overlap_sideways_are_free() -> None:
    left = resting(TISSUES, np.eye(3), 0.0, 0.0)
    width = float(library()[TISSUES].extents[0])
    for gap in (0.001, -0.004):
        right = make_pose(p=[width + gap, 0.01, 0.0]) @ left
        assert above(((TISSUES, left), (TISSUES, right))) == {0: set(), 1: set()}


def test_a_book_that_leans_on_a_bar_of_soap_is_on_it() -> None:
    soap = resting(SOAP, FLAT, 0.0, 0.0)
    corners = library()[SOAP].mesh.vertices @ soap[:3, :3].T + soap[:3, 3]
    edge = np.array([corners[:, 0].max(), 0.0, corners[:, 2].max()])
    # The book slopes down along x, its lower end on the table.
    slope = np.radians(20.0)
    normal = np.array([np.sin(slope), 0.0, np.cos(slope)])
    down = np.array([np.cos(slope), 0.0, -np.sin(slope)])
    R = np.stack([normal, down, np.cross(normal, down)], axis=1)
    book = resting(BOOK, R, 0.0, 0.0)
    underside = ((library()[BOOK].mesh.vertices @ R.T + book[:3, 3]) @ normal).min()
    book = make_pose(p=[(edge @ normal - underside) / normal[0], 0.0, 0.0]) @ book
    assert above(((SOAP, soap), (BOOK, book))) == {0: {1}, 1: set()}
