# SPDX-License-Identifier: MIT
from __future__ import annotations

import pytest

from physim_drake.errors import InputError
from physim_drake.estimation.config import EstimationConfig, Method
from physim_drake.estimation.method_config import MethodConfig


def test_the_method_and_its_effort_are_set_and_nothing_else() -> None:
    config = MethodConfig(Method.PCA_ICP, 7, 5, 2).applied_to(EstimationConfig(seed=3))
    assert (config.method, config.workers, config.seed) == (Method.PCA_ICP, 2, 3)
    assert config.search.expansions == 7
    assert config.steps.hypotheses.clustering.representatives == 5


def test_the_defaults_are_those_of_an_estimate() -> None:
    assert MethodConfig().applied_to(EstimationConfig()) == EstimationConfig()


@pytest.mark.parametrize("name", ["expansions", "representatives", "workers"])
def test_an_effort_of_nothing_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"estimator: {name}: is 0"):
        MethodConfig(**{name: 0})  # type: ignore[arg-type]
