# SPDX-License-Identifier: MIT
from __future__ import annotations

import pytest

from physim_drake.batch.image_names import choose_images
from physim_drake.datasets.bop import Target
from physim_drake.errors import InputError

TARGETS = [Target(1, 0, 1, 1), Target(1, 0, 2, 1), Target(2, 5, 1, 1)]


def test_all_images_with_targets_are_chosen_if_none_is_named() -> None:
    assert choose_images(TARGETS) == [(1, 0), (2, 5)]


def test_an_image_that_is_named_twice_is_chosen_once() -> None:
    assert choose_images(TARGETS, ["2/5", "2/5"]) == [(2, 5)]


@pytest.mark.parametrize("name", ["", "1", "1/", "a/0", "1/0/2", "-1/0", "1/٣"])
def test_a_name_is_two_numbers(name: str) -> None:
    with pytest.raises(InputError, match="is not an image"):
        choose_images(TARGETS, [name])


def test_an_image_without_a_target_is_refused_in_the_words_of_the_caller() -> None:
    expected = "--images: 1/3 has no target; there are 1/0, 2/5"
    with pytest.raises(InputError, match=expected):
        choose_images(TARGETS, ["1/3"], "--images")
