# SPDX-License-Identifier: MIT
"""`physim-drake estimate-image`: poses in one depth image, without a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from physim_drake.cli.options import (
    Expansions,
    Hypotheses,
    LogLevel,
    Quiet,
    Seed,
    Surface,
    Workers,
    surface_height,
)
from physim_drake.cli.output import LogLevelName, messages
from physim_drake.errors import InputError
from physim_drake.parallel.cores import default_workers

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physim_drake.camera import CameraIntrinsics
    from physim_drake.observation.observation import Detection, RgbdObservation


def estimate_image(
    depth: Annotated[
        Path,
        typer.Option(
            metavar="PNG", help="Depth image, 16 bits, one channel.", show_default=False
        ),
    ],
    intrinsics: Annotated[
        str,
        typer.Option(
            metavar="FX,FY,CX,CY",
            help="Focal lengths and principal point, in pixels of the depth image.",
            show_default=False,
        ),
    ],
    models: Annotated[
        Path,
        typer.Option(
            metavar="DIR", help="Folder of the object models.", show_default=False
        ),
    ],
    boxes: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=L,T,R,B",
            help="Box around an object, in pixels. Repeat it for each object.",
            show_default="one of each model, anywhere in the image",
        ),
    ] = None,
    color: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Colour image, registered to depth, for the overlay.",
            show_default="none",
        ),
    ] = None,
    depth_scale: Annotated[
        float, typer.Option(help="Metres for each unit of the depth image.")
    ] = 0.001,
    surface: Surface = "auto",
    overlay: Annotated[
        Path | None,
        typer.Option(
            metavar="PNG", help="Write the poses over the image.", show_default="none"
        ),
    ] = None,
    directives: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write Drake model directives and the models' SDFs.",
            show_default="none",
        ),
    ] = None,
    expansions: Expansions = 250,
    hypotheses: Hypotheses = 25,
    workers: Workers = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Estimate the poses in one depth image, without a dataset.

    It prints the pose of each object in the world, which is the support surface: z is
    up, and the origin is where the optical axis meets the surface.

    Example: `physim-drake estimate-image --depth depth.png --color color.png
    --intrinsics 615,615,319.5,239.5 --models meshes --boxes mug=158,177,252,337`
    """
    from physim_drake.cli.progress import Steps
    from physim_drake.estimation.estimator import EstimationConfig, estimate_scene
    from physim_drake.objects.library_files import find_objects
    from physim_drake.objects.model import ObjectLibrary
    from physim_drake.storage.files import check_writable, make_folder

    height = surface_height(surface)
    observation = read_image(depth, color, intrinsics, depth_scale)
    known = {entry.name: entry.object_id for entry in find_objects(models)}
    detections = named_boxes(boxes or [], known, observation.intrinsics)
    config = EstimationConfig(seed=seed, workers=workers or default_workers())
    config = config.with_budget(expansions, hypotheses)
    if overlay is not None:
        make_folder(overlay.parent)
        check_writable(overlay)
    with Steps(messages(quiet), "step", 2) as steps:
        steps.begin(0, "reading models")
        library = ObjectLibrary.load(models, {d.object_id for d in detections})
        steps.advance("estimating")
        estimate = estimate_scene(observation, library, detections, config, height)
        steps.advance()
    typer.echo(estimate)
    if overlay is not None:
        estimate.draw(overlay)
    if directives is not None:
        typer.echo(estimate.to_model_directives(library, directives))


def read_image(
    depth: Path, color: Path | None, intrinsics: str, depth_scale: float
) -> RgbdObservation:
    """Reads the image files.

    Args:
        depth: 16-bit depth image.
        color: colour image of the same size, or None.
        intrinsics: "fx,fy,cx,cy" in pixels.
        depth_scale: metres for each unit of the depth image.

    Raises:
        InputError: if a file or a value cannot be used.
    """
    import numpy as np

    from physim_drake.camera import CameraIntrinsics
    from physim_drake.datasets.images import read_color, read_depth
    from physim_drake.observation.observation import RgbdObservation

    fx, fy, cx, cy = _four("--intrinsics", intrinsics, "fx,fy,cx,cy in pixels")
    if not 0 < depth_scale < 1:
        raise InputError(
            "--depth-scale", f"is {depth_scale:g}", "give metres per unit, as in 0.001"
        )
    raw = read_depth(depth)
    camera = CameraIntrinsics(raw.shape[1], raw.shape[0], fx, fy, cx, cy)
    return RgbdObservation(
        raw.astype(np.float32) * np.float32(depth_scale),
        camera,
        None if color is None else read_color(color),
        name=str(depth),
    )


def named_boxes(
    boxes: list[str], known: Mapping[str, int], camera: CameraIntrinsics
) -> list[Detection]:
    """Reads "NAME=left,top,right,bottom"; without any, looks everywhere for each model.

    Args:
        boxes: boxes as they were given.
        known: ids of the models by their names.
        camera: camera of the image.

    Raises:
        InputError: if one is not of this form, is outside the image, or names no model.
    """
    from physim_drake.observation.observation import Detection

    if not boxes:
        whole = (0, 0, camera.width, camera.height)
        return [Detection(object_id, whole) for object_id in known.values()]
    detections = []
    for text in boxes:
        name, _, numbers = text.rpartition("=")
        corners = _four(f"--boxes {text}", numbers, "NAME=left,top,right,bottom")
        if name not in known:
            raise InputError(
                f"--boxes {text}",
                f"names no model {name!r}",
                f"the models are {', '.join(known)}",
            )
        left, top, right, bottom = corners
        if right <= 0 or bottom <= 0 or left >= camera.width or top >= camera.height:
            raise InputError(
                f"--boxes {text}",
                f"lies outside the image of {camera.width} x {camera.height}",
                "give left, top, right, bottom in pixels of the depth image",
            )
        detections.append(Detection(known[name], corners))
    return detections


def _four(option: str, text: str, form: str) -> tuple[float, float, float, float]:
    """The four finite numbers of "a,b,c,d"."""
    import math

    try:
        a, b, c, d = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(option, f"is {text!r}", f"give {form}") from None
    if not all(map(math.isfinite, (a, b, c, d))):
        raise InputError(option, f"is {text!r}", f"give {form}")
    return a, b, c, d
