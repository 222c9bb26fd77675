"""Standard errors and the ridge that the stage fit writes beside the parameters; configure leaves
nothing of a model that params.yaml does not name.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_options import parameters

from pipeline.core import config, contracts
from pipeline.core.errors import ModelDomainError
from pipeline.models.closed_loop import fitted_closed_loop
from pipeline.models.kinds import fitted_model, fitted_models
from pipeline.stages import configure, fit, predict


def metrics_of(model: str) -> dict[str, float]:
    return json.loads(Path(f"data/fit/{model}/fit.json").read_text())


def uncertain(metrics: dict[str, float]) -> set[str]:
    """Names of the estimates that have a standard error."""
    end = "_standard_error"
    names = {name.removesuffix(end) for name in metrics if name.endswith(end)}
    return {name for name in names if not name.startswith("closed_loop_")}


@pytest.mark.parametrize("model", ["additive", "gaussian", "wishart"])
def test_every_estimate_has_a_standard_error_and_an_interval(project, choose, model):
    choose(models=["additive", "gaussian", "wishart"])
    fit.run(model)
    metrics, chosen = metrics_of(model), config.sections("fit", item=model)
    stems = {"gaussian": ["noise_level"], "additive": []}
    stems["wishart"] = ["sigma_b", "control_qr_transposed_sigma_b"]
    names = uncertain(metrics)
    for name in ("moments", "paper", "likelihood"):
        assert {f"{stem}_{name}" for stem in stems[model]} <= names
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
    for name in ("joints", "process_noise"):
        table = contracts.read(name, fit.TRACK).query("part == 'training'")
        few = table[table["take"].isin(sorted(table["take"].unique())[:9])]
        contracts.write(few, name, fit.TRACK)
    fit.run("gaussian")
    metrics = metrics_of("gaussian")
    assert metrics["takes"] == 9 and "noise_level_standard_error" in metrics
    intervals = [name for name in metrics if "_interval_" in name]
    assert all(name.startswith("closed_loop") for name in intervals)


def test_noise_of_the_measurement_alone_gives_no_model_and_later_stages_leave_it_out(
    project, choose, capsys
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


def test_the_closed_loop_stands_beside_the_open_one_unless_the_options_say_no(project, choose):
    fit.run("gaussian")
    model, share = fitted_closed_loop(fit.OUT / "gaussian")
    metrics = metrics_of("gaussian")
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
    assert "closed_loop_share" not in metrics_of("gaussian")


def test_a_motion_that_never_rests_has_no_closed_loop_and_says_so(project, capsys):
    trajectory = contracts.read("trajectory", fit.MOTION)
    trajectory["v:x"] += 1e-6
    contracts.write(trajectory, "trajectory", fit.MOTION)
    fit.run("additive")
    assert fitted_closed_loop(fit.OUT / "additive") is None
    assert "additive has no closed loop: the motion never rests" in capsys.readouterr().out


def test_results_of_models_that_are_not_chosen_go_and_the_others_stay(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parameters(tmp_path, models="[additive]")
    for place in ("data/fit/additive", "data/fit/scaled", "data/filter/wishart"):
        Path(place).mkdir(parents=True)
        Path(place, "parameters.json").touch()
    configure.run()
    left = [str(file) for file in Path("data").rglob("*.json")]
    assert left == ["data/fit/additive/parameters.json"]
    assert Path("data/config.yaml").is_file()
