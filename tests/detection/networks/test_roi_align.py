# SPDX-License-Identifier: MIT
from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.detection.networks.roi_align import pyramid_levels, roi_align


def read(features: torch.Tensor, box: list[float], size: int) -> torch.Tensor:
    """One box of a map of stride 1."""
    zero = torch.zeros(1, dtype=torch.int64)
    return roi_align([features], [1], torch.tensor([box]), zero, zero, size)[0]


def test_a_box_of_whole_cells_reads_them():
    features = torch.arange(16.0).reshape(1, 1, 4, 4)
    # Samples lie at quarters of a cell; on a ramp their mean is the cell's value.
    out = read(features, [1.0, 1.0, 3.0, 3.0], 2)
    torch.testing.assert_close(out[0], features[0, 0, 1:3, 1:3])


def test_a_box_between_cells_reads_their_mean():
    features = torch.tensor([[0.0, 1.0], [2.0, 3.0]])[None, None]
    # All four samples lie in the middle square; by hand: 0.75, 1.25, 1.75, 2.25.
    out = read(features, [0.5, 0.5, 1.5, 1.5], 1)
    torch.testing.assert_close(out, torch.tensor([[[1.5]]]))


def test_beyond_the_border_the_nearest_cell_holds():
    features = torch.arange(4.0).reshape(1, 1, 2, 2)
    assert read(features, [-9.0, -9.0, -5.0, -5.0], 1).item() == 0.0
    assert read(features, [7.0, 7.0, 9.0, 9.0], 1).item() == 3.0


@given(
    data=st.tuples(*[st.floats(0.0, 20.0)] * 2, *[st.floats(1.0, 12.0)] * 2),
    size=st.integers(1, 7),
)
def test_a_ramp_is_read_exactly(data: tuple[float, ...], size: int):
    """Bilinear sampling is exact on a plane, so cell values are known."""
    left, top, width, height = data
    y, x = torch.meshgrid(torch.arange(40.0), torch.arange(40.0), indexing="ij")
    out = read(
        torch.stack([x + 0.5, y + 0.5])[None],
        [left, top, left + width, top + height],
        size,
    )
    share = (torch.arange(size) + 0.5) / size
    inside = (left + share * width).clamp(0.5, 39.5)
    # Samples left of the first centre are clamped one by one.
    if left + width / size / 4 >= 0.5:
        torch.testing.assert_close(out[0, 0], inside, atol=1e-3, rtol=1e-4)
    if top + height / size / 4 >= 0.5:
        torch.testing.assert_close(
            out[1, :, 0], top + share * height, atol=1e-3, rtol=1e-4
        )


def test_boxes_read_their_own_image_and_level():
    fine = torch.stack([torch.full((3, 8, 8), 1.0), torch.full((3, 8, 8), 2.0)])
    coarse = torch.stack([torch.full((3, 4, 4), 3.0), torch.full((3, 4, 4), 4.0)])
    box = torch.tensor([[2.0, 2.0, 20.0, 20.0]]).repeat(4, 1)
    out = roi_align(
        [fine, coarse],
        [4, 8],
        box,
        torch.tensor([0, 1, 0, 1]),
        torch.tensor([0, 0, 1, 1]),
        2,
    )
    assert out.shape == (4, 3, 2, 2)
    torch.testing.assert_close(out[:, 0, 0, 0], torch.tensor([1.0, 2.0, 3.0, 4.0]))
    assert (out == out[:, :1, :1, :1]).all()


def test_gradients_reach_the_cells_that_were_read():
    features = torch.zeros(1, 1, 6, 6, requires_grad=True)
    read(features, [2.0, 2.0, 4.0, 4.0], 2).sum().backward()
    assert features.grad is not None
    torch.testing.assert_close(features.grad.sum(), torch.tensor(4.0))
    assert (features.grad[0, 0, 0] == 0).all()
    assert (features.grad[0, 0, 2:4, 2:4] > 0).all()


def test_no_boxes():
    none = torch.zeros(0, dtype=torch.int64)
    out = roi_align([torch.zeros(1, 5, 4, 4)], [1], torch.zeros(0, 4), none, none, 3)
    assert out.shape == (0, 5, 3, 3)


def test_levels_by_size():
    sizes = torch.tensor([10.0, 64.0, 65.0, 128.0, 129.0, 5000.0, 0.0])
    boxes = torch.stack([torch.zeros(7), torch.zeros(7), sizes, sizes], dim=1)
    assert pyramid_levels(boxes, 4, 64.0).tolist() == [0, 0, 1, 1, 2, 3, 0]
