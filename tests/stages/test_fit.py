"""The stage fit writes standard errors and the ridge beside the parameters; configure removes the
models that params.yaml does not name; predict scores every model and baseline on takes that it was
not fitted to; readings decides what the recordings without a camera have evidence on.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from recordings_of_law import JOINTS, MODELS, REST, TAKES, TRUE
from sample_options import parameters
from scipy.stats import multivariate_normal

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.errors import ModelDomainError
from pipeline.models.closed_loop import fitted_closed_loop
from pipeline.models.kinds import build_model, fitted_model
from pipeline.models.prediction import score_steps
from pipeline.models.steps import Recorded, process_noise
from pipeline.recordings.steps import training_steps
from pipeline.stages import configure, fit, predict, readings


def metrics_of(model: str) -> dict[str, float]:
    return json.loads(Path(f"data/fit/{model}/fit.json").read_text())


@pytest.mark.parametrize("model", ["additive", "gaussian", "wishart"])
def test_every_estimate_has_a_standard_error_and_an_interval(project, choose, model):
    choose(models=["additive", "gaussian", "wishart"])
    fit.run(model)
    metrics = metrics_of(model)
    stems = {
        "additive": [],
        "gaussian": ["noise_level"],
        "wishart": ["sigma_b", "control_qr_transposed_sigma_b"],
    }
    end = "_standard_error"
    names = {name.removesuffix(end) for name in metrics if name.endswith(end)}
    names = {name for name in names if not name.startswith("closed_loop_")}

    for estimator in ("moments", "paper", "likelihood"):
        assert {f"{stem}_{estimator}" for stem in stems[model]} <= names
    for name in names:
        assert metrics[f"{name}_interval_low"] <= metrics[f"{name}_interval_high"]
        assert 0 < metrics[f"{name}_standard_error"] < 0.5 * abs(metrics[name]) + 0.2

    scale = config.sections("fit", item=model).scale
    assert metrics["bootstrap_replicates"] == scale.bootstrap_replicates
    assert metrics["bootstrap_replicates_without_an_estimate"] == 0
    covariance = json.loads((fit.OUT / model / "covariance.json").read_text())
    for name in covariance["estimates"]:
        assert metrics.get(f"{name}_moments", metrics[name]) == metrics[name]


def test_an_unbounded_bound_has_no_interval_and_along_its_ridge_the_level_stays(
    project,
):
    fit.run("gaussian")
    metrics = metrics_of("gaussian")
    parameters = json.loads((fit.OUT / "gaussian/parameters.json").read_text())

    assert parameters["u_unbounded"] == bool(metrics["u_unbounded"])
    for estimator in ("", "_moments", "_paper", "_likelihood"):
        for name in ("u", "alpha"):
            has_one = f"{name}{estimator}_interval_low" in metrics
            assert has_one == (metrics[f"u{estimator}_unbounded"] == 0)
        assert f"noise_level{estimator}_interval_low" in metrics

    ridge = contracts.read("ridge", fit.OUT / "gaussian")
    assert np.ptp(ridge["level"]) < 0.1 * ridge["level"].mean()
    assert ridge["alpha"].iloc[-1] < 0.5 * ridge["alpha"].iloc[0]


@pytest.mark.slow
def test_noise_of_the_measurement_alone_gives_no_model_and_later_stages_leave_it_out(
    project,
    choose,
    capsys,
):
    """The reason is in the place of the parameters, and every stage that needs them prints it."""
    choose(models=["additive", "gaussian", "wishart"])
    noise = contracts.read("process_noise", predict.TRACK)
    trajectory = contracts.read("trajectory", fit.MOTION)
    moving = trajectory.loc[trajectory.filter(like="v:").any(axis=1), "k"]
    quiet = noise["k"].isin(moving + 1)
    noise.loc[quiet, noise.filter(like="w:").columns] *= 1e-3
    contracts.write(noise, "process_noise", predict.TRACK)
    for model in ("additive", "gaussian", "wishart"):
        fit.run(model)
    printed = capsys.readouterr().out
    for model in ("gaussian", "wishart"):
        assert f"no model {model}: the recorded process noise" in printed
        with pytest.raises(ModelDomainError, match="does not exceed the measurement"):
            fitted_model(fit.OUT / model)
        assert not contracts.exists("moments", fit.OUT / model)

    metrics = metrics_of("wishart")
    assert "sigma_b" not in metrics
    assert "sigma_b_paper" in metrics

    predict.run()
    left_out = "predict: wishart is left out: the recorded process noise"
    assert left_out in capsys.readouterr().out

    predicted = set(contracts.read("predictions", predict.OUT)["model"])
    assert "additive" in predicted
    assert predicted.isdisjoint({"wishart", "gaussian"})


def test_a_closed_loop_is_fitted_beside_the_open_one_unless_the_options_say_no(
    project,
    choose,
):
    fit.run("gaussian")
    model, share = fitted_closed_loop(fit.OUT / "gaussian")
    metrics = metrics_of("gaussian")
    assert metrics["closed_loop_share"] == share
    assert metrics["closed_loop_share_standard_error"] > 0
    assert metrics["closed_loop_alpha"] == model.alpha
    assert metrics["closed_loop_u"] == model.u
    # the takes are drawn in an open loop
    assert metrics["closed_loop_share_interval_low"] < 0.01

    choose(overrides={"models": {"gaussian": {"closed_loop": False}}})
    fit.run("gaussian")
    assert fitted_closed_loop(fit.OUT / "gaussian") is None
    assert "closed_loop_share" not in metrics_of("gaussian")


def test_results_of_models_that_are_not_chosen_go_and_the_others_stay(
    tmp_path,
    monkeypatch,
):
    monkeypatch.chdir(tmp_path)
    parameters(tmp_path, models="[additive]")
    for place in ("data/fit/additive", "data/fit/gaussian", "data/filter/wishart"):
        Path(place).mkdir(parents=True)
        Path(place, "parameters.json").touch()
    configure.run()
    left = [str(file) for file in Path("data").rglob("*.json")]

    assert left == ["data/fit/additive/parameters.json"]
    assert Path("data/config.yaml").is_file()


def log_scores() -> pd.DataFrame:
    rows = contracts.read("predictions", predict.OUT)
    of_all = (rows["steps"] == "all") & (rows["score"] == "log_score")
    return rows[of_all].set_index("model")


def test_a_stated_noise_of_a_pose_is_twice_in_the_noise_of_a_step(project):
    settings = config.composed_config().dataset
    stated = training_steps(settings.robot, replace(settings.motion, pose_noise=3e-3))

    assert_allclose(stated.measurement, 2 * 9e-6 * np.eye(len(JOINTS)))
    assert training_steps(settings.robot, settings.motion).known_measurement is None


@pytest.mark.slow
def test_the_true_model_predicts_best_and_its_coverage_is_a_normal_ones(
    project,
    choose,
):
    choose(models=["gaussian", "additive", "wishart"])
    predict.run()
    scores = log_scores()
    plain = {"none", "memory", "additive", "joint_step_t", "speed"}
    # beside a Wishart model the control that depends on no unit
    wishart = {"wishart", "wishart_qr_transposed"}
    assert {*scores.index} == {"gaussian"} | plain | wishart
    assert scores["mean"].idxmax() == "gaussian"
    assert scores.loc["gaussian", "low"] > 0
    rows = contracts.read("predictions", predict.OUT)
    assert rows["steps"].nunique() == 5
    means = rows.set_index(["steps", "model", "score"])["mean"]
    for joint in JOINTS:
        coverage = means["all", "gaussian", f"coverage_of_one_sigma_{joint}"]
        assert coverage == pytest.approx(0.683, abs=0.05)

    # control: twice the noise has a lower log score
    twice = MODELS["gaussian"] | {"alpha": 2 * MODELS["gaussian"]["alpha"]}
    Path("data/fit/gaussian/parameters.json").write_text(json.dumps(twice))
    predict.run()
    assert log_scores().loc["gaussian", "mean"] < scores.loc["gaussian", "mean"] - 0.1


@pytest.mark.slow
def test_without_test_takes_each_is_predicted_by_the_others(project, choose):
    joints = contracts.read("joints", predict.TRACK)
    noise = contracts.read("process_noise", predict.TRACK)
    training = joints[joints["part"] == "training"]
    contracts.write(training, "joints", predict.TRACK)
    choose(models=["additive"])
    predict.run()
    held_out = log_scores().loc["none", "mean"]
    # the control: where every take is there twice it is predicted by itself, and far better
    for name, rows in (("joints", training), ("process_noise", noise)):
        again = rows.assign(take=rows["take"] + "_")
        contracts.write(pd.concat([rows, again]), name, predict.TRACK)
    predict.run()

    assert log_scores().loc["none", "mean"] > held_out + 0.3


def test_every_other_reading_has_evidence_of_the_wishart_model_and_of_no_other(
    project,
    choose,
):
    readings.run()
    rows = contracts.read("readings", readings.OUT)
    refusals = contracts.read("reading_refusals", readings.OUT)
    assert list(refusals["reading"]) == ["pivoted LU", "QR of J", "QR of Jᵀ (control)"]
    assert {*rows["reading"]} == {*refusals["reading"][1:]}
    assert {"std_error", "greatest_mean_error"} < {*rows["quantity"]}
    # without a camera there is none on filters; no other model depends on the reading
    assert not rows["quantity"].str.contains("bound|filter|camera").any()
    assert (rows["model"].eq("wishart") | rows["rival"].eq("wishart")).all()

    choose(models=["additive"])
    readings.run()
    assert readings.OUT.is_dir() and not contracts.exists("readings", readings.OUT)


def test_every_step_of_a_take_is_scored_by_the_density_of_its_law(known_project):
    _, chain, q, v = known_project
    training = q[:TAKES]
    take = q[TAKES]
    noise = process_noise(chain, training, v)
    recorded = Recorded(chain, training[:, :-1], v, noise, tuple(JOINTS))

    scores, _ = score_steps(build_model(MODELS["gaussian"]), recorded, take)

    for k in (0, REST + 29):
        before = take[k]
        after = take[k + 1]
        mean = before + np.linalg.solve(chain.jacobian(before), v[k])
        covariance = TRUE.covariance(chain, before, v[k]) + recorded.measurement
        error = after - mean
        log_density = multivariate_normal(mean, covariance).logpdf(after)
        nees = error @ np.linalg.solve(covariance, error)
        z = error / np.sqrt(np.diag(covariance))
        assert scores["log_density"][k] == pytest.approx(log_density)
        assert scores["nees"][k] == pytest.approx(nees)
        assert scores["z"][k, 1] == pytest.approx(z[1])
