"""The stage predict scores every model and baseline on takes that it was not fitted to."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from known_law import JOINTS

from pipeline.core import contracts
from pipeline.stages import fit, predict

OUT, TRACK = Path("data/predict"), Path("data/track")


def log_scores() -> pd.DataFrame:
    rows = contracts.read("predictions", OUT)
    return rows[(rows["steps"] == "all") & (rows["score"] == "log_score")].set_index("model")


def test_the_true_model_predicts_best_and_its_coverage_is_a_normal_ones(project, choose):
    choose(models=["gaussian", "gaussian_ml", "additive"])
    predict.run()
    scores = log_scores()
    plain = {"none", "memory", "additive", "scaled", "scaled_full"}
    assert {*scores.index} == {"gaussian", "gaussian_ml"} | plain
    assert scores["mean"].idxmax() == "gaussian" and scores.loc["gaussian", "low"] > 0
    pairs = contracts.read("prediction_pairs", OUT)
    # the control: twice the noise is worse by an interval that excludes zero
    wider = pairs[(pairs["model"] == "gaussian") & (pairs["rival"] == "gaussian_ml")]
    assert (wider["low"][wider["steps"] == "all"] > 0).all()
    rows = contracts.read("predictions", OUT).set_index(["steps", "model", "score"])["mean"]
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
    assert contracts.exists("ranges", OUT) and not contracts.exists("predictions", OUT)
