# SPDX-License-Identifier: MIT
"""A network in place of a file of detections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from physim_drake.datasets.bop import BopDataset, ImageId, Target
from physim_drake.detection.detect_images import known_targets, target_names
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.known_models import require_same_sizes
from physim_drake.observation.detection_selection import assign_detections
from physim_drake.observation.observation import Detection


def network_lookup(
    dataset: BopDataset,
    weights: Path,
    targets: Sequence[Target] | None = None,
    *,
    like: Path | None = None,
    pixels: bool = False,
) -> tuple[Callable[[ImageId], list[Detection]], str]:
    """Detections that a network makes when they are looked up.

    If the targets say what an image shows, each of them gets the detection that is
    most likely its own; see `assign_detections`. After those comes, for each object
    that no target names, `Detection.unseen`.

    Args:
        dataset: dataset that holds the images.
        weights: file of the network's weights.
        targets: objects to look for. None takes the dataset's own.
        like: folder of the models that the network was trained with. Objects of the
            dataset without a name must be as large as these. With None, their ids
            are trusted.
        pixels: use only the part that classifies every pixel. See
            `NetworkDetector.load`.

    Returns:
        the look-up, and the name of its source.

    Raises:
        InputError: if the weights cannot be used, or are for other objects than
            the targets. The look-up raises it if an image has no colour.
    """
    shown = known_targets(dataset) if targets is None else targets
    names = target_names(dataset, shown)
    detector = NetworkDetector.load(weights, pixels=pixels)
    detector.check_objects(names, dataset.root)
    if like is not None:
        nameless = [object_id for object_id, name in names.items() if not name]
        require_same_sizes(nameless, dataset.models, like, detector.source)
    # A dataset that does not say what it shows may show all that the network knows.
    wanted = names or {c.object_id: c.name for c in detector.classes}

    def look_up(image: ImageId) -> list[Detection]:
        """The detections in an image, boxes in pixels. The network runs each time."""
        observation = dataset.observation(*image)
        found = detector.detect(observation.need_color(), observation.depth)
        height, width = observation.depth.shape
        counts = {t.object_id: t.count for t in shown if (t.scene_id, t.im_id) == image}
        if counts:
            found = assign_detections(found, counts, (height, width))
        known = [d for d in found if d.object_id in wanted]
        rest = [i for i in wanted if i not in counts]
        return [*known, *(Detection.unseen(i, height, width) for i in rest)]

    return look_up, str(weights.resolve())
