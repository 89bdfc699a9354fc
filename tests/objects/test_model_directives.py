# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
import yaml
from pydrake.multibody.parsing import LoadModelDirectivesFromString

from physim_drake.objects.model_directives import (
    Fixed,
    Tagged,
    add_frame,
    add_model,
    add_weld,
    directives_text,
)

TURN = Tagged("!AngleAxis", {"angle_deg": Fixed(90.0, 3), "axis": Fixed([0, 0, 1], 1)})
DIRECTIVES = [
    add_model("a", "package://p/ä.sdf", {"translation": Fixed([0.1, -2, 3], 2)}),
    add_frame("f", {"rotation": TURN}),
    add_weld("f", "a::body"),
]
TEXT = """\
directives:
- add_model:
    name: a
    file: package://p/ä.sdf
    default_free_body_pose:
      body:
        translation: [0.10, -2.00, 3.00]
- add_frame:
    name: f
    X_PF:
      base_frame: world
      rotation: !AngleAxis
        angle_deg: 90.000
        axis: [0.0, 0.0, 1.0]
- add_weld:
    parent: f
    child: a::body
"""


def test_the_text_is_laid_out_for_readers() -> None:
    assert directives_text(DIRECTIVES) == TEXT


def test_drake_reads_what_is_written() -> None:
    model, frame, weld = LoadModelDirectivesFromString(TEXT).directives
    X = model.add_model.default_free_body_pose["body"].GetDeterministicValue()
    np.testing.assert_allclose(X.translation(), [0.1, -2.0, 3.0])
    X = frame.add_frame.X_PF.GetDeterministicValue()
    np.testing.assert_allclose(X.rotation().ToAngleAxis().angle(), np.pi / 2)
    assert weld.add_weld.child == "a::body"


def test_other_users_of_yaml_see_nothing_of_it() -> None:
    with pytest.raises(yaml.representer.RepresenterError):
        yaml.safe_dump(TURN)
