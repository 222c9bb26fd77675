"""The stage predict scores every model and baseline on takes that it was not fitted to; the stage
readings decides what the recordings have evidence on, with a depth camera or without.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from known_law import JOINTS, ROOT, TAKES

from pipeline.core import contracts
from pipeline.core.columns import spread
from pipeline.stages import fit, predict, readings

TRACK = Path("data/track")


def log_scores() -> pd.DataFrame:
    rows = contracts.read("predictions", predict.OUT)
    return rows[(rows["steps"] == "all") & (rows["score"] == "log_score")].set_index("model")


def test_the_true_model_predicts_best_and_its_coverage_is_a_normal_ones(project, choose):
    choose(models=["gaussian", "gaussian_ml", "additive"])
    predict.run()
    scores = log_scores()
    plain = {"none", "memory", "additive", "scaled", "scaled_full"}
    assert {*scores.index} == {"gaussian", "gaussian_ml"} | plain
    assert scores["mean"].idxmax() == "gaussian" and scores.loc["gaussian", "low"] > 0
    pairs = contracts.read("prediction_pairs", predict.OUT)
    # the control: twice the noise is worse by an interval that excludes zero
    wider = pairs[(pairs["model"] == "gaussian") & (pairs["rival"] == "gaussian_ml")]
    assert (wider["low"][wider["steps"] == "all"] > 0).all()
    rows = contracts.read("predictions", predict.OUT).set_index(["steps", "model", "score"])["mean"]
    assert len(rows.index.get_level_values(0).unique()) == 5
    for joint in JOINTS:
        coverage = rows["all", "gaussian", f"coverage_of_one_sigma_{joint}"]
        assert coverage == pytest.approx(0.683, abs=0.05)


def test_beside_a_wishart_model_the_control_that_depends_on_no_unit_is_scored(project, choose):
    choose(models=["wishart", "additive"])
    fit.run("wishart")
    fit.run("additive")
    predict.run()
    assert {"wishart", "wishart_qr_transposed"} < {*log_scores().index}


@pytest.mark.slow
def test_without_test_takes_each_is_predicted_by_the_others(project, choose):
    joints, noise = (contracts.read(name, TRACK) for name in ("joints", "process_noise"))
    training = joints[joints["part"] == "training"]
    contracts.write(training, "joints", TRACK)
    choose(models=["additive"])
    predict.run()
    held_out = log_scores().loc["none", "mean"]
    # the control: where every take is there twice it is predicted by itself, and far better
    for name, rows in (("joints", training), ("process_noise", noise)):
        contracts.write(pd.concat([rows, rows.assign(take=rows["take"] + "_")]), name, TRACK)
    predict.run()
    assert log_scores().loc["none", "mean"] > held_out + 0.3


def test_a_motion_that_never_rests_has_ranges_and_no_scores(project, choose):
    table = contracts.read("trajectory", Path("data/ingest/motion"))
    moving = table.assign(**{"v:x": table["v:x"] + 1e-9})
    contracts.write(moving, "trajectory", Path("data/ingest/motion"))
    choose(models=["additive"])
    predict.run()
    assert contracts.exists("ranges", predict.OUT) and not contracts.exists(
        "predictions", predict.OUT
    )


NOISE = 1e-4 * np.eye(3)


@pytest.fixture
def claims(project) -> None:
    """The paper's claims in the project."""
    Path("reports").mkdir(exist_ok=True)
    Path("reports/claims.yaml").write_bytes((ROOT / "reports/claims.yaml").read_bytes())


def film(project) -> None:
    """A depth camera that saw the test takes at every tenth step."""
    _, q, _ = project
    k = np.arange(0, q.shape[1], 10)
    rng = np.random.default_rng(2)
    angles = q[TAKES:, k] + rng.multivariate_normal(np.zeros(3), NOISE, (TAKES, len(k)))
    takes = [f"take_{number:02d}" for number in range(TAKES, 2 * TAKES)]
    frame = {"take": np.repeat(takes, len(k)), "part": "test"}
    frame |= {"frame": np.tile(np.arange(len(k)), TAKES), "t": np.tile(k / 100, TAKES)}
    nodes = dict.fromkeys(("x2", "z2", "x3", "z3", "xe", "ze"), 0.0)
    fit = {"points": 1, "objective": 0.0}
    table = pd.DataFrame(frame | spread("q", JOINTS, angles) | nodes | fit)
    Path("data/articulate").mkdir(parents=True)
    contracts.write(table, "angles", Path("data/articulate"))


def verdicts() -> pd.DataFrame:
    """The readings' verdicts by claim and reading."""
    readings.run()
    rows = contracts.read("readings", readings.OUT)
    return rows.pivot(index="claim", columns="reading", values="holds")


def test_without_a_camera_the_claims_about_motion_alone_are_decided(project, claims):
    ruled = verdicts()
    assert set(ruled.columns) == {"pivoted LU", "QR of J", "QR of Jᵀ (control)"}
    assert not any(claim.startswith(("filter", "kinect", "wrench")) for claim in ruled.index)
    assert {"spread-followed-by-wishart", "mean-error"} <= set(ruled.index)
    # no reading of the Wishart model bears on the others
    of_gaussian = ruled.loc["spread-followed-by-gaussian"]
    assert of_gaussian.nunique() == 1


@pytest.mark.slow
def test_with_a_camera_the_filter_is_decided_and_again_the_same(project, claims):
    film(project)
    ruled = verdicts()
    assert {"filter-accuracy-equal", "kinect-biased"} <= set(ruled.index)
    pd.testing.assert_frame_equal(ruled, verdicts())


def test_without_a_wishart_model_nothing_is_written(project, claims, choose):
    choose(models=["additive"])
    readings.run()
    assert readings.OUT.is_dir() and not contracts.exists("readings", readings.OUT)
