# SPDX-License-Identifier: MIT
"""``import physim_drake as physim``: light, complete, and at home in a notebook."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import physim_drake as physim
from physim_drake.datasets.images import read_color
from physim_drake.estimation.image_estimate import ImageEstimate
from physim_drake.notebook import image_html, table_html
from physim_drake.poses import inverse
from tests.synthetic import SOAP, X_WC, library, stack, synthesize

EXAMPLE = Path(__file__).parents[1] / "examples" / "data" / "tabletop"


def test_every_name_loads() -> None:
    for name in dir(physim):
        assert getattr(physim, name) is not None


def test_old_import_paths_lead_to_the_same_things() -> None:
    from physim_drake.estimation import EstimationConfig, PoseEstimator, estimate_scene
    from physim_drake.objects import ObjectLibrary, ObjectModel
    from physim_drake.observation import Detection, RgbdObservation

    for thing in (
        *(EstimationConfig, PoseEstimator, estimate_scene, ObjectLibrary),
        *(ObjectModel, Detection, RgbdObservation),
    ):
        assert getattr(physim, thing.__name__) is thing


@pytest.mark.parametrize(
    "name",
    [
        *("datasets.bop", "datasets.detections", "datasets.results", "estimation"),
        *("models", "objects", "observation", "systems", "testing"),
    ],
)
def test_modules_that_the_docs_named_are_still_there(name: str) -> None:
    assert importlib.import_module(f"physim_drake.{name}")


def test_the_import_alone_loads_nothing_heavy() -> None:
    program = "import sys, physim_drake; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert not {"numpy", "pydrake", "torch"} & {*done.stdout.split()}


def test_boxes_may_be_lists() -> None:
    detection = physim.Detection(3, [10, 20, 30, 40])
    assert detection.box.dtype == float
    assert detection.pixels(50, 50).sum() == 400


@pytest.mark.parametrize("box", [[1, 2, 3], [1, 2, 3, np.nan], np.eye(4)])
def test_what_is_not_a_box_is_refused(box: object) -> None:
    with pytest.raises(physim.InputError, match="give left, top, right, bottom"):
        physim.Detection(3, box)  # type: ignore[arg-type]


def test_a_dataset_named_by_text_gives_its_detections() -> None:
    dataset = physim.BopDataset(str(EXAMPLE))
    found = dataset.detections(1, 0)
    loaded = physim.load_detections(str(EXAMPLE / "detections.json"), dataset)[1, 0]
    assert [d.object_id for d in found] == [d.object_id for d in loaded]
    assert dataset.detections(1, 99) == []


@pytest.fixture(scope="module")
def estimate() -> ImageEstimate:
    """A stack as it truly is; one of its objects counts as not found."""
    view = synthesize(stack())
    X_CW = inverse(X_WC)
    objects = tuple(
        physim.ObjectEstimate(k, library()[k].name, X_CW @ X, X, 0.9, "")
        if k != SOAP
        else physim.ObjectEstimate(k, library()[k].name, None, None, 0.0, "too <few>")
        for (k, X) in stack()
    )
    found = physim.SceneEstimate(objects, view.surface, "by hand", {})
    return ImageEstimate.of(found, view.observation, library())


def test_only_what_has_a_pose_is_found(estimate: ImageEstimate) -> None:
    assert SOAP not in [item.object_id for item in estimate.found]
    assert len(estimate.found) == len(estimate.objects) - 1


def test_an_estimate_draws_itself(estimate: ImageEstimate, tmp_path: Path) -> None:
    height, width = estimate.observation.depth.shape
    image = estimate.draw(tmp_path / "overlay.png")
    assert image.shape == (height, 2 * width, 3)
    np.testing.assert_array_equal(read_color(tmp_path / "overlay.png"), image)


def test_an_estimate_shows_itself_in_a_notebook(estimate: ImageEstimate) -> None:
    text = estimate._repr_html_()
    assert f"<td>{estimate.found[0].name}</td>" in text
    assert "not found (too &lt;few&gt;)" in text
    assert text.count("<img ") == 1


def test_an_observation_shows_itself_in_a_notebook(estimate: ImageEstimate) -> None:
    observation = estimate.observation
    assert observation._repr_html_().startswith("<img ")
    assert repr(observation) == "<observation: 320 x 240, no colour>"


def test_table_and_image_are_html() -> None:
    text = table_html(["a", "b"], [["1 < 2", "x"]])
    assert "<td>1 &lt; 2</td>" in text
    image = image_html(np.zeros((2, 3, 3), np.uint8), 'a "view"')
    assert image.startswith('<img src="data:image/png;base64,')
    assert "a &quot;view&quot;" in image
