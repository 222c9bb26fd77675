"""Standard errors and the ridge that the stage writes beside the parameters of a fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.core import config, contracts
from pipeline.stages import fit


@pytest.mark.parametrize("model", ["additive", "gaussian"])
def test_every_estimate_has_a_standard_error_and_an_interval(project, model):
    fit.run(model)
    metrics = json.loads(Path(f"reports/metrics/fit_{model}.json").read_text())
    names = [
        name.removesuffix("_standard_error") for name in metrics if name.endswith("_standard_error")
    ]
    assert len(names) == {"additive": 9, "gaussian": 3}[model]
    for name in names:
        assert metrics[f"{name}_interval_low"] <= metrics[f"{name}_interval_high"]
        assert 0 < metrics[f"{name}_standard_error"] < 0.5 * abs(metrics[name]) + 0.2
    assert (
        metrics["bootstrap_replicates"]
        == config.sections("fit", item=model).scale.bootstrap_replicates
    )
    assert metrics["bootstrap_replicates_without_an_estimate"] == 0


def test_along_the_ridge_the_level_stays_while_alpha_falls(project):
    fit.run("gaussian")
    ridge = contracts.read("ridge", fit.OUT / "gaussian")
    assert np.ptp(ridge["level"]) < 0.1 * ridge["level"].mean()
    assert ridge["alpha"].iloc[-1] < 0.5 * ridge["alpha"].iloc[0]
