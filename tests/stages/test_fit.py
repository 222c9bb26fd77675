"""Standard errors and the ridge that the stage writes beside the parameters of a fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from pipeline.core import config, contracts
from pipeline.core.errors import ModelDomainError
from pipeline.models.closed_loop import fitted_closed_loop
from pipeline.models.kinds import fitted_model, fitted_models
from pipeline.stages import fit, predict


def metrics_of(model: str) -> dict[str, float]:
    return json.loads(Path(f"data/fit/{model}/fit.json").read_text())


def choose(**changes) -> None:
    params = OmegaConf.load("params.yaml")
    params.update(changes)
    OmegaConf.save(params, "params.yaml")
    config.write_config(Path("params.yaml"))


def uncertain(metrics: dict[str, float]) -> set[str]:
    """Names of the estimates that have a standard error."""
    end = "_standard_error"
    names = {name.removesuffix(end) for name in metrics if name.endswith(end)}
    return {name for name in names if not name.startswith("closed_loop_")}


@pytest.mark.parametrize("model", ["additive", "gaussian", "wishart"])
def test_every_estimate_has_a_standard_error_and_an_interval(project, model):
    choose(models=["additive", "gaussian", "wishart"])
    fit.run(model)
    metrics, chosen = metrics_of(model), config.sections("fit", item=model)
    compared = {
        "additive": set(),
        "gaussian": {f"noise_level_{name}" for name in ("moments", "paper", "likelihood")},
        "wishart": {
            f"{prefix}sigma_b_{name}"
            for prefix in ("", "control_qr_transposed_")
            for name in ("moments", "paper", "likelihood")
        },
    }[model]
    names = uncertain(metrics)
    assert compared <= names
    for name in names:
        assert metrics[f"{name}_interval_low"] <= metrics[f"{name}_interval_high"]
        assert 0 < metrics[f"{name}_standard_error"] < 0.5 * abs(metrics[name]) + 0.2
    assert metrics["bootstrap_replicates"] == chosen.scale.bootstrap_replicates
    assert metrics["bootstrap_replicates_without_an_estimate"] == 0
    for name in json.loads((fit.OUT / model / "covariance.json").read_text())["estimates"]:
        assert metrics.get(f"{name}_moments", metrics[name]) == metrics[name]


def test_an_unbounded_bound_has_no_interval_and_says_so(project):
    fit.run("gaussian")
    metrics = metrics_of("gaussian")
    parameters = json.loads((fit.OUT / "gaussian/parameters.json").read_text())
    assert parameters["u_unbounded"] == bool(metrics["u_unbounded"])
    for estimator in ("", "_moments", "_paper", "_likelihood"):
        for name in ("u", "alpha"):
            has_one = f"{name}{estimator}_interval_low" in metrics
            assert has_one == (metrics[f"u{estimator}_unbounded"] == 0)
        assert f"noise_level{estimator}_interval_low" in metrics


def test_fewer_than_ten_takes_have_standard_errors_and_no_intervals(project):
    for name, place in (("joints", fit.TRACK), ("process_noise", fit.TRACK)):
        table = contracts.read(name, place)
        if "part" in table:
            table = table[table["part"] == "training"]
        contracts.write(table[table["take"].isin(sorted(table["take"].unique())[:9])], name, place)
    fit.run("gaussian")
    metrics = metrics_of("gaussian")
    assert metrics["takes"] == 9 and "noise_level_standard_error" in metrics
    assert not [
        name for name in metrics if "_interval_" in name and not name.startswith("closed_loop")
    ]


def test_noise_of_the_measurement_alone_gives_no_model_and_later_stages_leave_it_out(
    project, capsys
):
    """The reason stands in place of the parameters, and every stage that would need them prints
    it.
    """
    choose(models=["additive", "gaussian", "wishart"])
    noise = contracts.read("process_noise", fit.TRACK)
    trajectory = contracts.read("trajectory", fit.MOTION)
    moving = trajectory.loc[trajectory.filter(like="v:").any(axis=1), "k"]
    quiet = noise["k"].isin(moving + 1)
    noise.loc[quiet, noise.filter(like="w:").columns] *= 1e-3
    contracts.write(noise, "process_noise", fit.TRACK)
    for model in ("additive", "gaussian", "wishart"):
        fit.run(model)
    printed = capsys.readouterr().out
    for model in ("gaussian", "wishart"):
        assert f"no model {model}: the variance of the recorded process noise" in printed
        with pytest.raises(ModelDomainError, match="not above that of the measurement"):
            fitted_model(fit.OUT / model)
        assert not contracts.exists("moments", fit.OUT / model)
    assert "sigma_b" not in metrics_of("wishart") and "sigma_b_paper" in metrics_of("wishart")
    assert [*fitted_models(["additive", "wishart"], fit.OUT, "score")] == ["additive"]
    predict.run()
    printed = capsys.readouterr().out
    for stage in ("score", "predict"):
        assert f"{stage}: wishart is left out: the variance" in printed
    predicted = set(contracts.read("predictions", predict.OUT)["model"])
    assert "additive" in predicted and not {"wishart", "gaussian"} & predicted


def test_along_the_ridge_the_level_stays_while_alpha_falls(project):
    fit.run("gaussian")
    ridge = contracts.read("ridge", fit.OUT / "gaussian")
    assert np.ptp(ridge["level"]) < 0.1 * ridge["level"].mean()
    assert ridge["alpha"].iloc[-1] < 0.5 * ridge["alpha"].iloc[0]


def test_the_closed_loop_stands_beside_the_open_one_unless_the_options_say_no(project, capsys):
    fit.run("gaussian")
    model, share = fitted_closed_loop(fit.OUT / "gaussian")
    metrics = json.loads(Path("data/fit/gaussian/fit.json").read_text())
    assert metrics["closed_loop_share"] == share
    assert metrics["closed_loop_gain_per_s"] == pytest.approx(100 * share)
    error = metrics["closed_loop_share_standard_error"]
    assert metrics["closed_loop_gain_per_s_standard_error"] == pytest.approx(100 * error)
    assert (metrics["closed_loop_alpha"], metrics["closed_loop_u"]) == (model.alpha, model.u)
    # the takes are drawn in an open loop
    assert metrics["closed_loop_share_interval_low"] < 0.01
    choose(overrides={"models": {"gaussian": {"closed_loop": False}}})
    fit.run("gaussian")
    assert fitted_closed_loop(fit.OUT / "gaussian") is None
    assert "closed_loop_share" not in json.loads(Path("data/fit/gaussian/fit.json").read_text())


def test_a_motion_that_never_rests_has_no_closed_loop_and_says_so(project, capsys):
    trajectory = contracts.read("trajectory", fit.MOTION)
    trajectory["v:x"] += 1e-6
    contracts.write(trajectory, "trajectory", fit.MOTION)
    fit.run("additive")
    assert fitted_closed_loop(fit.OUT / "additive") is None
    assert "additive has no closed loop: the motion never rests" in capsys.readouterr().out
