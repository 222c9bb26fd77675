"""The study of the baselines as a stage: what it writes, and what it predicts from what."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_law import JOINTS, MODELS, TAKES

from pipeline.core import config, contracts
from pipeline.models.kinds import build_model, estimate
from pipeline.models.noise import process_noise
from pipeline.models.prediction import score_take
from pipeline.models.steps import Recorded
from pipeline.studies.baselines import stage
from pipeline.verdicts.run import read_run

TABLES = stage.HERE / "tables.yaml"


def differences() -> dict[str, float]:
    rows = contracts.read("model_scores", stage.OUT, TABLES)
    rows = rows[(rows["steps"] == "moving") & (rows["score"] == "log_score")]
    return rows.set_index("model")["mean"].to_dict()


@pytest.mark.slow
def test_every_model_and_baseline_is_scored_and_the_evidence_of_all_datasets_is_on_the_page(
    project, capsys
):
    folder = Path("reports/studies/baselines")
    stage.run()
    first = differences()
    assert set(first) == {*MODELS, "scaled", "scaled_full"}
    assert first["gaussian"] == max(first.values())
    written = folder / f"{config.sections('report').dataset.name}.json"
    (folder / "other.json").write_text(written.read_text().replace("youbot", "other"))
    stage.run()
    assert differences() == first and read_run(written).tables.keys() == {
        "model_scores",
        "log_score_differences",
    }
    page = Path("reports/studies/baselines.md").read_text()
    assert "**youbot.**" in page and "**other.**" in page
    assert "wishart gives no mean and covariance" in capsys.readouterr().out


def test_without_test_takes_each_take_is_predicted_by_the_fit_to_the_others(project):
    chain, q, v = project
    options = config.model_options(["gaussian"])
    noise = process_noise(chain, q[:TAKES], v)
    recorded = Recorded(chain, q[:TAKES, :-1], v, noise, tuple(JOINTS))
    takes = {0: ("take_00", q[0])}
    scores, _ = score_take(("gaussian", 0), takes, recorded, options, 1)
    others = recorded.subset(np.arange(1, TAKES))
    model = estimate(others, options["gaussian"]).model
    expected = model.log_density(chain, q[0, :-1], v, q[0, 1:], others.measurement)
    assert scores["log_density"] == pytest.approx(expected)
    # control: the fit to all takes knows the one to be predicted
    model = estimate(recorded, options["gaussian"]).model
    known = model.log_density(chain, q[0, :-1], v, q[0, 1:], recorded.measurement)
    assert np.abs(known - expected).max() > 1e-3
    # and a fitted model predicts as it is
    fitted = {"gaussian": build_model(MODELS["gaussian"])}
    scores, _ = score_take(("gaussian", 0), takes, recorded, fitted, 1)
    density = fitted["gaussian"].log_density(chain, q[0, :-1], v, q[0, 1:], recorded.measurement)
    assert scores["log_density"] == pytest.approx(density)


def test_a_motion_that_never_rests_says_so(never_resting, capsys):
    stage.run()
    assert "never rests" in capsys.readouterr().out
    assert "never rests" in Path("reports/studies/baselines.md").read_text()
