"""Standard errors and the ridge that the stage writes beside the parameters of a fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from pipeline.core import config, contracts
from pipeline.models.closed_loop import fitted_closed_loop
from pipeline.stages import fit


@pytest.mark.parametrize("model", ["additive", "gaussian"])
def test_every_estimate_has_a_standard_error_and_an_interval(project, model):
    fit.run(model)
    metrics = json.loads(Path(f"reports/metrics/fit_{model}.json").read_text())
    names = [
        name.removesuffix("_standard_error") for name in metrics if name.endswith("_standard_error")
    ]
    names = [name for name in names if not name.startswith("closed_loop_")]
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


def test_the_closed_loop_stands_beside_the_open_one_unless_the_options_say_no(project, capsys):
    fit.run("gaussian")
    model, share = fitted_closed_loop(fit.OUT / "gaussian")
    metrics = json.loads(Path("reports/metrics/fit_gaussian.json").read_text())
    assert metrics["closed_loop_share"] == share
    assert metrics["closed_loop_gain_per_s"] == pytest.approx(100 * share)
    error = metrics["closed_loop_share_standard_error"]
    assert metrics["closed_loop_gain_per_s_standard_error"] == pytest.approx(100 * error)
    assert (metrics["closed_loop_alpha"], metrics["closed_loop_u"]) == (model.alpha, model.u)
    # the takes are drawn in an open loop
    assert metrics["closed_loop_share_interval_low"] < 0.01
    params = OmegaConf.load("params.yaml")
    params.overrides = {"models": {"gaussian": {"closed_loop": False}}}
    OmegaConf.save(params, "params.yaml")
    config.write_config(Path("params.yaml"))
    fit.run("gaussian")
    assert fitted_closed_loop(fit.OUT / "gaussian") is None
    assert "closed_loop_share" not in json.loads(
        Path("reports/metrics/fit_gaussian.json").read_text()
    )


def test_a_motion_that_never_rests_has_no_closed_loop_and_says_so(project, capsys):
    trajectory = contracts.read("trajectory", fit.MOTION)
    trajectory["v:x"] += 1e-6
    contracts.write(trajectory, "trajectory", fit.MOTION)
    fit.run("additive")
    assert fitted_closed_loop(fit.OUT / "additive") is None
    assert "additive has no closed loop: the motion never rests" in capsys.readouterr().out
