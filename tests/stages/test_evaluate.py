"""One-step predictions on takes drawn from a known model: calibrated and best where the model is the true one, and not where it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from known_law import REST, STEPS, TAKES, TRUE, rows
from scipy.stats import multivariate_normal

from pipeline import config, contracts
from pipeline.motion.estimation import Recorded, estimate
from pipeline.motion.noise import process_noise
from pipeline.stages import evaluate, score
from pipeline.statistics.comparison import compared
from pipeline.statistics.scores import nees_band, paired_difference


def scored(model: str) -> pd.DataFrame:
    evaluate.run(model)
    return contracts.read("one_step_scores", Path(f"data/evaluate/{model}"))


def test_every_step_of_every_test_take_is_scored_by_the_density_of_its_law(project):
    chain, q, v = project
    table = scored("gaussian")
    assert table["take"].nunique() == TAKES and (table["part"] == "test").all() and len(table) == TAKES * STEPS
    noise = rows(np.pad(process_noise(chain, q, v), ((0, 0), (1, 0), (0, 0))), "w")
    at_rest = noise[(noise.part == "training") & (noise.k > 0) & (noise.k <= REST)]
    measured = np.mean([group[["w1", "w2", "w3"]].cov().to_numpy() for _, group in at_rest.groupby("k")], axis=0)
    for k in (1, REST + 30):
        before, after = q[TAKES, k - 1], q[TAKES, k]
        mean = before + np.linalg.solve(chain.jacobian(before), v[k - 1])
        law = multivariate_normal(mean, TRUE.covariance(chain, before, v[k - 1]) + measured)
        row = table[table.k == k].iloc[0]
        assert row["log_density"] == pytest.approx(law.logpdf(after))
        assert row["nees"] == pytest.approx((after - mean) @ np.linalg.solve(law.cov, after - mean))
        assert row["z2"] == pytest.approx((after - mean)[1] / np.sqrt(law.cov[1, 1]))
        assert row["moving"] == (k > REST) and np.isnan(row["log_density_noiseless"]) == (k <= REST)
        if k > REST:
            alone = multivariate_normal(mean, TRUE.covariance(chain, before, v[k - 1]))
            assert row["log_density_noiseless"] == pytest.approx(alone.logpdf(after))


def test_the_true_model_is_calibrated_and_a_wrong_one_is_not(project):
    low, high = nees_band(TAKES * (STEPS - REST), 3, level=0.999)
    true, wrong = (table[table.moving] for table in map(scored, ("gaussian", "gaussian_ml")))
    assert low < true["nees"].mean() < high
    assert not low < wrong["nees"].mean() < high


@pytest.mark.parametrize(("column", "sign"), [("log_density", 1), ("energy", -1)])
def test_the_true_model_scores_best_beyond_its_interval(project, column, sign):
    by_take = [scored(model).groupby("take")[column].mean().to_numpy() for model in ("gaussian", "gaussian_ml", "additive")]
    for other in by_take[1:]:
        difference = paired_difference(by_take[0], other)
        assert np.sign(difference.low) == np.sign(difference.high) == sign


def test_what_a_model_does_not_have_is_a_gap_with_a_printed_reason(project, capsys):
    table = scored("wishart")
    said = capsys.readouterr().out
    assert f"wishart gives no mean and covariance in {TAKES} of {TAKES} takes" in said and "sigma_B 1.2" in said
    assert table[["z1", "z2", "z3", "nees", "log_determinant"]].isna().all(axis=None)
    assert np.isfinite(table[["log_density", "energy"]]).all(axis=None)
    # a gap stays one in the comparison, and does not become a number
    summary = compared(score._one_step_scores(["wishart"])["moving"]).set_index("score")
    assert np.isnan(summary.loc["nees", "mean"]) and np.isnan(summary.loc["coverage_of_one_sigma_q1", "mean"])
    assert np.isfinite(summary.loc["log_score", "mean"])


def test_the_same_seed_gives_the_same_scores_and_another_model_its_own_draws(project):
    first, again, other = (scored(model)["energy"].to_numpy() for model in ("gaussian", "gaussian", "gaussian_ml"))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_without_test_takes_each_take_is_predicted_by_the_fit_to_the_others(project, capsys):
    chain, q, v = project
    joints = contracts.read("joints", Path("data/track"))
    contracts.write(joints[joints.part == "training"], "joints", Path("data/track"))
    table = scored("gaussian")
    assert "no test takes" in capsys.readouterr().out
    assert set(table["take"]) == {f"take_{i:02d}" for i in range(TAKES)}
    options = vars(config.sections("evaluate", item="gaussian").models)["gaussian"]
    others = Recorded(chain, q[1:TAKES, :-1], v, process_noise(chain, q[1:TAKES], v))
    first = estimate(others, options).model.log_density(chain, q[0, :-1], v, q[0, 1:], others.measurement)
    assert table.loc[table["take"] == "take_00", "log_density"].to_numpy() == pytest.approx(first)
    # control: the fit to all takes knows the one to be predicted
    everything = Recorded(chain, q[:TAKES, :-1], v, process_noise(chain, q[:TAKES], v))
    seen = estimate(everything, options).model.log_density(chain, q[0, :-1], v, q[0, 1:], everything.measurement)
    assert np.abs(seen - first).max() > 1e-3


def test_a_motion_that_never_rests_says_so(project, capsys):
    trajectory = contracts.read("trajectory", Path("data/ingest"))
    contracts.write(trajectory.assign(vx=0.01), "trajectory", Path("data/ingest"))
    evaluate.run("gaussian")
    assert "never rests" in capsys.readouterr().out


def test_models_are_compared_with_the_first_by_paired_differences_over_takes(project):
    tables = {model: scored(model) for model in ("gaussian", "additive")}
    summary = compared(score._one_step_scores(list(tables))["all"]).set_index(["model", "score"])
    by_take = [table.groupby("take")["log_density"].mean().to_numpy() for table in tables.values()]
    row = summary.loc["additive", "log_score"]
    assert row["mean"] == pytest.approx(by_take[1].mean())
    assert tuple(row[["difference", "low", "high"]]) == pytest.approx(tuple(paired_difference(by_take[1], by_take[0])))
    assert summary.loc["gaussian"][["difference", "low", "high"]].isna().all(axis=None)
    z = tables["additive"][["z1", "z2", "z3"]].abs()
    assert summary.loc["additive", "coverage_of_one_sigma_q3"]["mean"] == pytest.approx((z["z3"] <= 1).mean())


def test_a_posterior_is_scored_as_a_normal_law_of_the_measured_pose(project):
    _, q, _ = project
    rng = np.random.default_rng(5)
    joints = contracts.read("joints", Path("data/track"))
    stated = np.diag([2e-6, 4e-6, 1e-6])
    noise = contracts.read("process_noise", Path("data/noise"))
    of_pose = np.mean([group[["w1", "w2", "w3"]].cov().to_numpy() for _, group in noise[noise.k <= REST].groupby("k")], axis=0) / 2
    means = q[TAKES:] + rng.multivariate_normal(np.zeros(3), stated + of_pose, (TAKES, STEPS + 1))
    table = rows(np.concatenate([q[:TAKES], means]), "m")
    table = table[table.part == "test"].assign(ess=10.0, resampled=False, measured=True, clipped=0, outside=0)
    for name, factor in (("right", 1.0), ("narrow", 0.5)):
        entries = {f"c{i + 1}{j + 1}": factor * stated[i, j] for i in range(3) for j in range(i, 3)}
        Path(f"data/filter/{name}").mkdir(parents=True)
        contracts.write(table.assign(**entries), "posterior", Path(f"data/filter/{name}"))
    summary = compared(score._posterior_scores(["right", "narrow"], joints)).set_index(["model", "score"])
    cases = TAKES * (STEPS + 1)
    low, high = nees_band(cases, 3, level=0.999)
    assert low < summary.loc["right", "nees"]["mean"] < high < summary.loc["narrow", "nees"]["mean"]
    assert abs(summary.loc["right", "coverage_of_the_95_percent_region"]["mean"] - 0.95) < 4 * np.sqrt(0.95 * 0.05 / cases)
    assert summary.loc["right", "share_of_steps_with_nees_in_its_95_percent_band"]["mean"] > 0.85
    assert summary.loc["narrow", "share_of_steps_with_nees_in_its_95_percent_band"]["mean"] < 0.7
    assert summary.loc["narrow", "log_score"]["high"] < 0
    error = means - q[TAKES:]
    assert summary.loc["right", "rms_error_q2_rad"]["mean"] == pytest.approx(np.sqrt(np.mean(error[..., 1] ** 2, axis=1)).mean())
