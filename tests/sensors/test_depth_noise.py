# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.sensors.depth_noise import DepthNoise, measure_depth
from physim_drake.sensors.presets import PRESETS, CameraName

K = CameraIntrinsics(160, 120, 150.0, 150.0, 80.0, 60.0)
NONE = DepthNoise.none()


def wall(z: float) -> DepthImage:
    return np.full((K.height, K.width), z, np.float32)


def step(near: float = 0.5, far: float = 0.7) -> DepthImage:
    """A near strip, columns 60 to 99, before a wall."""
    depth = wall(far)
    depth[:, 60:100] = near
    return depth


def tilted(angle: float) -> DepthImage:
    """A plane through (0, 0, 0.6) whose normal makes `angle` with the axis, rad."""
    x = (np.arange(K.width) - K.cx) / K.fx
    z = 0.6 / (1.0 + np.tan(angle) * x)
    return np.tile(np.where(z > 0, z, 0.0), (K.height, 1)).astype(np.float32)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def measure(depth: DepthImage, **changes: float) -> DepthImage:
    return measure_depth(depth, K, replace(NONE, **changes), rng())


@pytest.mark.parametrize("name", list(CameraName))
@pytest.mark.parametrize("z", [0.35, 0.5, 0.7, 1.0, 1.4])
def test_error_grows_with_the_square_of_distance(name: CameraName, z: float):
    """sigma_z = z^2 s / (f B), with every effect of the preset switched on.

    The step of the disparity adds a twelfth of its square to the variance.
    """
    noise = PRESETS[name].noise
    truth = wall(z)
    errors = []
    for seed in range(8):
        measured = measure_depth(truth, K, noise, rng(seed))
        errors.append((measured - truth)[measured > 0])
    error = np.concatenate(errors)
    expected = z**2 / (noise.focal_length * noise.baseline)
    expected *= np.hypot(noise.disparity_error, noise.disparity_step / np.sqrt(12))
    expected = np.hypot(expected, noise.depth_unit / np.sqrt(12))
    assert np.std(error) == pytest.approx(expected, rel=0.08)
    assert noise.sigma(np.array(z)) == pytest.approx(np.std(error), rel=0.13)
    assert abs(np.mean(error)) < 0.15 * expected


def test_published_figures():
    """f 665 px, B 55 mm, s 0.08 px: 0.55 mm at 0.5 m, 2.19 mm at 1 m."""
    sigma = PRESETS[CameraName.D415].noise.sigma(np.array([0.5, 1.0]))
    assert sigma == pytest.approx([0.55e-3, 2.19e-3], rel=0.01)
    sigma = PRESETS[CameraName.D435].noise.sigma(np.array([0.5, 1.0]))
    assert sigma == pytest.approx([0.94e-3, 3.75e-3], rel=0.01)


def test_errors_of_neighbours_are_alike():
    noise = DepthNoise().without_holes()
    error = measure_depth(wall(0.7), K, noise, rng()) - 0.7
    error -= error.mean()

    def correlation(shift: int) -> float:
        product = error[:, shift:] * error[:, : error.shape[1] - shift]
        return float(product.mean() / error.var())

    assert correlation(1) > 0.8
    assert abs(correlation(15)) < 0.15


def test_perfect_camera_changes_nothing():
    depth = step()
    depth[:20] = 0.0
    assert measure_depth(depth, K, NONE, rng()) == pytest.approx(depth, rel=1e-6)


def test_same_seed_same_image():
    images = [measure_depth(step(), K, DepthNoise(), rng(3)) for _ in range(2)]
    assert np.array_equal(*images)
    assert not np.array_equal(images[0], measure_depth(step(), K, DepthNoise(), rng(4)))


def test_disparities_are_quantised():
    measured = measure(tilted(0.5), disparity_step=1 / 32)
    steps = NONE.focal_length * NONE.baseline / measured[measured > 0] * 32
    assert steps == pytest.approx(np.round(steps), abs=1e-3)
    assert len(np.unique(np.round(steps))) > 20


def test_depth_is_quantised():
    measured = measure(tilted(0.5), depth_unit=0.001) * 1000
    assert measured == pytest.approx(np.round(measured), abs=1e-3)


def test_range_is_limited():
    assert not measure(wall(0.2), min_range=0.29).any()
    assert not measure(wall(3.0), max_range=2.0).any()
    assert measure(wall(0.5), min_range=0.29, max_range=2.0).all()


@pytest.mark.parametrize("side", [1, -1])
def test_second_viewpoint_casts_a_shadow(side: int):
    """Its width is the difference of the disparities in pixels of this image."""
    measured = measure(step(), shadow_side=side)
    lost = np.flatnonzero(measured[60] == 0)
    width = K.fx * NONE.baseline * (1 / 0.5 - 1 / 0.7)
    assert len(lost) == pytest.approx(width, abs=1.5)
    assert lost.max() == 59 if side == 1 else lost.min() == 100
    assert (measured[:, 60:100] > 0).all()


def test_edges_lose_pixels_and_are_frayed():
    lost = measure(step(), edge_loss=0.5) == 0
    assert 0.2 < lost[:, [59, 60, 99, 100]].mean() < 0.8
    assert not lost[:, :50].any()
    assert not lost[:, 70:90].any()
    frayed = measure(step(), edge_jitter=0.8)
    assert (frayed[:, 60] == np.float32(0.7)).any()
    assert (frayed[:, 59] == np.float32(0.5)).any()
    assert np.array_equal(frayed[:, :50], step()[:, :50])


def test_grazing_surfaces_are_lost():
    depth = tilted(np.deg2rad(80))  # its cosine on the axis is 0.17
    near_axis = slice(78, 82)
    assert not measure(depth, grazing_cosine=0.2)[:, near_axis].any()
    some = (measure(depth, grazing_cosine=0.12)[:, near_axis] > 0).mean()
    assert 0.1 < some < 0.9
    assert measure(depth)[:, near_axis].all()
    assert measure(tilted(np.deg2rad(40)), grazing_cosine=0.15)[:, near_axis].all()


@pytest.mark.parametrize(
    ("level", "option"), [(3, "dark_loss"), (255, "shiny_loss")], ids=["dark", "shiny"]
)
def test_bad_surfaces_lose_their_share(level: int, option: str):
    color = np.full((K.height, K.width, 3), 128, np.uint8)
    color[:, :80] = level
    noise = replace(NONE, **{option: 0.4})
    lost = measure_depth(wall(0.5), K, noise, rng(), color) == 0
    assert lost[:, :80].mean() == pytest.approx(0.4, abs=0.05)
    assert not lost[:, 80:].any()
    assert measure_depth(wall(0.5), K, NONE, rng(), color).all()


def test_extrinsic_error_is_small_and_can_be_off():
    errors = np.stack([DepthNoise().draw_extrinsic_error(rng(i)) for i in range(400)])
    shift = errors[:, :3, 3]
    assert np.std(shift) == pytest.approx(DepthNoise().extrinsic_shift, rel=0.1)
    assert np.array_equal(NONE.draw_extrinsic_error(rng()), np.eye(4))


def test_nothing_stays_nothing():
    depth = wall(0.5)
    depth[:, :40] = 0.0
    assert not measure_depth(depth, K, DepthNoise(), rng())[:, :35].any()
