# SPDX-License-Identifier: MIT
"""Scenes as Drake model directives, which any plant can load.

Files are named relative to a package, `physim_scenes`, whose root is the folder of the
dataset; add it to a parser with
``parser.package_map().AddPackageXml("DATASET/package.xml")``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from physim_drake.objects.model_directives import (
    Fixed,
    Tagged,
    add_model,
    add_weld,
    directives_text,
)
from physim_drake.poses import Array
from physim_drake.scenes.generation import GeneratedScene

PACKAGE = "physim_scenes"

PACKAGE_XML = f"""<?xml version="1.0"?>
<package format="2">
  <name>{PACKAGE}</name>
  <version>0.0.0</version>
  <description>Generated scenes as Drake model directives.</description>
  <maintainer email="nobody@example.com">nobody</maintainer>
  <license>MIT</license>
</package>
"""


def scene_directives(scene: GeneratedScene, model_uris: Mapping[int, str]) -> str:
    """The scene as YAML for `pydrake.multibody.parsing.LoadModelDirectives`.

    Args:
        scene: scene; its objects become free bodies named `object_<index>`.
        model_uris: path of each object's SDF below the package, by object id.
    """
    root, container = f"package://{PACKAGE}", str(scene.container)
    directives = [
        add_model(container, f"{root}/drake_models/{container}.sdf"),
        add_weld("world", f"{container}::body"),
    ]
    objects = zip(scene.object_ids, scene.X_WO, strict=True)
    for n, (object_id, X_WO) in enumerate(objects):
        uri = f"{root}/{model_uris[object_id]}"
        directives.append(add_model(f"object_{n}", uri, _transform(X_WO)))
    return directives_text(directives)


def _transform(X: Array) -> dict[str, object]:
    """A pose (4, 4) as Drake's schema has it."""
    rotvec = Rotation.from_matrix(X[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(rotvec))
    axis = rotvec / angle if angle > 1e-12 else np.array([0.0, 0.0, 1.0])
    turn = {
        "angle_deg": Fixed(float(np.rad2deg(angle)), 9),
        "axis": Fixed(axis.tolist(), 12),
    }
    return {
        "translation": Fixed(X[:3, 3].tolist(), 9),
        "rotation": Tagged("!AngleAxis", turn),
    }
