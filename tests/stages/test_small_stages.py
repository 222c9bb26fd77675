"""The stages without a test module of their own, on small projects: what they write and leave out;
a case with the run's choices has the evidence that the stage score writes.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from recordings_of_law import JOINTS, MEASUREMENT

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.columns import spread, values
from pipeline.core.errors import ConfigError
from pipeline.evidence.case import Camera, Choices, Recordings, recorded_takes
from pipeline.evidence.motion import NOISE, PAPERS
from pipeline.evidence.outcomes import evaluate
from pipeline.evidence.table import KEYS, NUMBERS
from pipeline.filtering.measurement import measured_takes
from pipeline.perception.depth_noise import errors_of, leave_one_out
from pipeline.stages import (
    articulate,
    choose,
    figures,
    filter,
    fit,
    publish,
    score,
    wrench,
)
from pipeline.verdicts.claims import read_claims
from pipeline.verdicts.decision import claim_verdicts
from pipeline.verdicts.run import ArmNames

THREE = ["additive", "wishart", "gaussian"]


def write_camera() -> None:
    """Joint angles at every fourth step of the test takes, and the moments of their noise."""
    measured = contracts.read("joints", Path("data/track"))
    joints = measured.query("part == 'test' and k % 4 == 0")
    rng = np.random.default_rng(3)
    noise = rng.multivariate_normal([0.01, 0.0, -0.01], 1e3 * MEASUREMENT, len(joints))

    seen = joints[["take", "part", "t"]].assign(frame=joints["k"] // 4, points=9)
    seen["objective"] = 0.0
    seen = seen.assign(**spread("q", JOINTS, values(joints, "q") + noise))
    seen = seen.assign(**dict.fromkeys(["x2", "z2", "x3", "z3", "xe", "ze"], 0.0))

    articulate.OUT.mkdir(parents=True)
    contracts.write(seen, "angles", articulate.OUT)
    errors = errors_of(seen, measured)
    contracts.write(leave_one_out(errors, window=2), "kinect_noise", articulate.OUT)


@pytest.mark.slow
def test_a_case_with_the_choices_of_the_run_has_the_runs_evidence_and_verdicts(
    project,
    choose,
    tmp_path,
    monkeypatch,
):
    choose(models=THREE)
    # the tables of losses and repairs, which these recordings lack
    monkeypatch.setattr(score, "_recording_tables", dict)
    write_camera()
    for model in THREE:
        fit.run(model)
        filter.run(model)
    settings = config.sections("score")
    scored = score._score_robot(settings, tmp_path)
    _, tables = scored["filter"]
    run = tables[score.EVIDENCE]
    run = run[~run["quantity"].str.startswith(("camera", "depth"))].copy()
    settings = config.sections("readings")
    takes = recorded_takes(settings.dataset.robot, settings.dataset.motion)
    measured = {take.take: take for take in measured_takes(settings.dataset)}
    base = replace(Choices.of_run(settings), closed=True)
    sizes = (
        settings.dataset.motion.rate,
        len(measured),
        settings.simulation.realizations,
    )
    cameras = {base.clock: Camera(None, measured)}
    recordings = Recordings(takes, cameras, *sizes, settings.seed)
    (result,) = evaluate([base], recordings, map)
    again = result.evidence
    # only a case scores the models on the test takes; only the run resamples the estimates
    again = again[again["quantity"] != "step_log_score"].copy()
    for table in (run, again):
        fitted = table["quantity"].isin([*NOISE, *PAPERS])
        table.loc[fitted, ["low", "high", "standard_error"]] = np.nan
    indexed = [
        table.set_index([*KEYS])[[*NUMBERS]].astype(float) for table in (run, again)
    ]
    pd.testing.assert_frame_equal(
        *indexed,
        check_like=True,
        rtol=1e-9,
        check_exact=False,
    )
    assert {"additive", "additive_closed", "none"} < {*run["model"]}

    arm = ArmNames(tuple(JOINTS), tuple(takes.training.chain.task))
    of_run, of_case = (
        claim_verdicts(read_claims(), table, arm)["verdict"] for table in (run, again)
    )
    assert of_run.tolist() == of_case.tolist() and {"holds", "fails"} < {*of_run}

    # control: other random numbers
    (other_draw,) = evaluate([replace(base, draw=1)], recordings, map)
    drawn = other_draw.evidence
    places = ["quantity", "model"]
    means = [
        t.set_index(places).loc["greatest_mean_error", "value"] for t in (run, drawn)
    ]
    assert not np.allclose(*means)


def test_the_chosen_dataset_is_written_and_an_unknown_one_is_refused_by_key(project):
    data = Path("data/raw")
    data.symlink_to(Path(__file__).parents[2] / data)
    choose.run()
    assert choose.CHOSEN.read_text() == "youbot\n"

    Path("params.yaml").write_text("dataset: nowhere\n")
    with pytest.raises(ConfigError) as refused:
        choose.run()
    assert (
        refused.value.evidence["key"] == "dataset"
        and choose.CHOSEN.read_text() == "youbot\n"
    )


def test_without_a_depth_camera_or_a_force_transducer_what_needs_them_is_left_out(
    project,
    choose,
):
    bounds = {"agents": [3, 4], "systems": 4, "test_systems": 5, "repeats": 2}
    absent = {"dataset": {"depth": None, "force": None}, "wrench": bounds}
    choose(overrides=absent)
    articulate.run()
    assert articulate.OUT.is_dir() and not any(articulate.OUT.iterdir())

    wrench.run()
    written = {file.stem for file in wrench.OUT.glob("*.parquet")}
    assert written == {"sigma_s", "wrench_errors", "wrench_spread"}
    errors = contracts.read("wrench_errors", wrench.OUT)
    assert errors.groupby("agents").size().to_dict() == {3: 5, 4: 5}


def test_figures_without_tables_are_left_out_and_publish_replaces_earlier_files(
    project,
    choose,
):
    choose(overrides={"dataset": {"force": None}})
    for folder in ("tables", "metrics"):
        (score.OUT / folder).mkdir(parents=True)
        (score.OUT / folder / "new.csv").write_text(folder)
    (score.OUT / "evidence.json").write_text('{"synthetic": true}')
    figures.run()
    captions = json.loads((figures.OUT / "captions.json").read_text())
    assert {file.stem for file in figures.OUT.glob("*.png")} == {*captions}

    earlier = Path("reports/youbot/tables/earlier.csv")
    earlier.parent.mkdir(parents=True)
    earlier.write_text("")
    publish.run()
    assert [file.name for file in earlier.parent.iterdir()] == ["new.csv"]
    assert Path("reports/youbot/metrics/new.csv").read_text() == "metrics"
    assert json.loads(Path("reports/youbot/captions.json").read_text()) == captions
    assert "synthetic" in json.loads(Path("reports/datasets/youbot.json").read_text())
    assert not (Path("reports/youbot/figures") / publish.CAPTIONS).exists()

    # a trial does not replace the results of another scale
    evidence = Path("reports/datasets/youbot.json")
    evidence.write_text('{"scale": "paper"}')
    choose(overrides={"dataset": {"force": None}}, scale="smoke")
    publish.run()
    assert evidence.read_text() == '{"scale": "paper"}'
    assert Path("reports/trials/youbot/metrics/new.csv").read_text() == "metrics"

    # a clone without pages of the dataset gets the pages of its trials, until a whole run
    shutil.rmtree("reports/trials")
    shutil.rmtree("reports/youbot")
    for _ in range(2):
        publish.run()
        assert Path("reports/youbot/metrics/new.csv").read_text() == "metrics"
        assert evidence.read_text() == '{"scale": "paper"}'
        assert not Path("reports/trials/youbot").exists()
    choose(overrides={"dataset": {"force": None}}, scale="paper")
    publish.run()
    assert not Path("reports/trials/datasets/youbot.json").exists()
    evidence.write_text('{"scale": "paper"}')
    choose(overrides={"dataset": {"force": None}}, scale="smoke")
    publish.run()
    assert Path("reports/trials/youbot/metrics/new.csv").read_text() == "metrics"

    # it replaces those of an earlier trial
    evidence.write_text('{"scale": "smoke"}')
    publish.run()
    assert "synthetic" in json.loads(evidence.read_text())
