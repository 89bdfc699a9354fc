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


def directives_text(scene: GeneratedScene, model_uris: Mapping[int, str]) -> str:
    """The scene as YAML for `pydrake.multibody.parsing.LoadModelDirectives`.

    Args:
        scene: scene; its objects become free bodies named `object_<index>`.
        model_uris: path of each object's SDF below the package, by object id.
    """
    lines = [
        "directives:",
        "- add_model:",
        f"    name: {scene.container}",
        f"    file: package://{PACKAGE}/drake_models/{scene.container}.sdf",
        "- add_weld:",
        "    parent: world",
        f"    child: {scene.container}::body",
    ]
    for n, (object_id, X_WO) in enumerate(
        zip(scene.object_ids, scene.X_WO, strict=True)
    ):
        rotvec = Rotation.from_matrix(X_WO[:3, :3]).as_rotvec()
        angle = float(np.linalg.norm(rotvec))
        axis = rotvec / angle if angle > 1e-12 else np.array([0.0, 0.0, 1.0])
        lines += [
            "- add_model:",
            f"    name: object_{n}",
            f"    file: package://{PACKAGE}/{model_uris[object_id]}",
            "    default_free_body_pose:",
            "      body:",
            f"        translation: [{', '.join(f'{x:.9f}' for x in X_WO[:3, 3])}]",
            "        rotation: !AngleAxis",
            f"          angle_deg: {np.rad2deg(angle):.9f}",
            f"          axis: [{', '.join(f'{x:.12f}' for x in axis)}]",
        ]
    return "\n".join(lines) + "\n"
