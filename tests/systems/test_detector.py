# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from physim_drake.camera import CameraIntrinsics
from physim_drake.errors import InputError
from physim_drake.observation.detection_selection import ChoiceConfig
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.systems.detector import (
    Detector,
    DetectorConfig,
    OracleDetector,
    TrainedDetector,
)
from physim_drake.systems.object_instances import ObjectInstance
from physim_drake.systems.stamped import Stamped
from tests.synthetic import ERASER, SOAP
from tests.systems.looks import build, shown

OBSERVATION = RgbdObservation(
    np.ones((60, 80), np.float32), CameraIntrinsics(80, 60, 70.0, 70.0, 39.5, 29.5)
)
INSTANCES = (
    ObjectInstance("soap", SOAP, 2),
    ObjectInstance("eraser", ERASER, 4),
    ObjectInstance("hidden", SOAP, 5),
)


DEFAULT = DetectorConfig()


def labels() -> Any:
    image = np.zeros((60, 80), np.int16)
    image[10:30, 20:50] = 2
    image[40:50, 5:25] = 4
    image[0, :4] = 5
    return image


def detected(
    algorithm: Any, config: DetectorConfig = DEFAULT, looks: int = 1
) -> list[Any]:
    """What a detector says of one image, look after look."""
    detector = Detector(algorithm, config)
    diagram = build(detector)
    context = diagram.CreateDefaultContext()
    inner = detector.GetMyMutableContextFromRoot(context)
    simulator = Simulator(diagram, context)
    seen = []
    for n in range(1, looks + 1):
        for port, value in (("observation", OBSERVATION), ("labels", labels())):
            detector.GetInputPort(port).FixValue(inner, Stamped(value, 0.0, n))
        simulator.AdvanceTo(n)
        seen.append(shown(detector, context, "detections").value)
    return seen


def test_an_oracle_knows_the_boxes_of_what_is_seen() -> None:
    (found,) = detected(OracleDetector(INSTANCES, jitter=0.0))
    assert [d.object_id for d in found] == [SOAP, ERASER]
    assert [d.box.tolist() for d in found] == [[20, 10, 50, 30], [5, 40, 25, 50]]
    assert all(0.9 <= d.score <= 1 for d in found)


def test_its_boxes_are_off_by_no_more_than_the_jitter() -> None:
    first, second = detected(OracleDetector(INSTANCES, jitter=0.1), looks=2)
    off = first[0].box - [20, 10, 50, 30]
    assert 0 < np.abs(off / [30, 20, 30, 20]).max() <= 0.1
    assert (first[0].box != second[0].box).any()


def test_the_same_look_is_always_detected_alike() -> None:
    def boxes(config: DetectorConfig) -> Any:
        return np.array(
            [[d.box for d in f] for f in detected(OracleDetector(INSTANCES), config, 2)]
        )

    np.testing.assert_array_equal(boxes(DetectorConfig()), boxes(DetectorConfig()))
    assert (boxes(DetectorConfig()) != boxes(DetectorConfig(seed=1))).any()


def test_objects_that_show_little_are_not_detected() -> None:
    (found,) = detected(OracleDetector(INSTANCES, min_pixels=4))
    assert len(found) == 3
    (found,) = detected(OracleDetector(INSTANCES, min_pixels=601))
    assert found == ()


def test_an_oracle_needs_labels() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="the oracle needs labels"):
        OracleDetector(INSTANCES).detect(OBSERVATION, None, rng)


class Network:
    """Sees what it is told to."""

    def __init__(self, *found: Detection) -> None:
        self._found = found

    def detect(self, color: Any, depth: Any) -> tuple[Detection, ...]:
        assert color.shape == (*depth.shape, 3)
        return self._found


def test_a_trained_detector_shows_its_network_the_colours() -> None:
    boxes = [np.array([5.0, 5, 25, 25]), np.array([40.0, 5, 60, 25])]
    network = Network(Detection(SOAP, boxes[0], 0.6), Detection(SOAP, boxes[1], 0.8))
    color = np.zeros((*OBSERVATION.depth.shape, 3), np.uint8)
    look = replace(OBSERVATION, color=color)
    rng = np.random.default_rng(0)
    (found,) = TrainedDetector(network, {SOAP: 1}).detect(look, None, rng)
    assert found.score == 0.8
    assert len(TrainedDetector(network, {SOAP: 2}).detect(look, None, rng)) == 2
    sure = ChoiceConfig(least_score=0.9)
    assert TrainedDetector(network, {SOAP: 2}, sure).detect(look, None, rng) == ()


def test_a_trained_detector_needs_colour() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="has no colour"):
        TrainedDetector(Network(), {SOAP: 1}).detect(OBSERVATION, None, rng)


def test_any_object_that_detects_is_a_detector() -> None:
    class Own:
        def detect(
            self, observation: RgbdObservation, labels: Any, generator: Any
        ) -> tuple[Detection, ...]:
            return (Detection(7, np.array([1.0, 2.0, 3.0, 4.0])),)

    assert detected(Own())[0][0].object_id == 7


def test_what_is_no_tuple_of_detections_is_refused() -> None:
    class Careless:
        def detect(self, observation: Any, labels: Any, generator: Any) -> Any:
            return [Detection(7, np.zeros(4))]

    with pytest.raises(
        TypeError, match=r"output port detections expects tuple\[Detection, ...\]"
    ):
        detected(Careless())
