"""Every study writes its tables, figure and page together, or nothing if a part fails; data of the
study of recovery have the stated law, and its table counts the estimates.
"""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from recordings_of_law import ROOT
from study_runs import NAMES, options_of, study_of, written

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.errors import ConfigError, ContractError
from pipeline.core.typed_yaml import read_yaml
from pipeline.models.kinds import build_model, estimate
from pipeline.models.steps import mean_covariance
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.recordings.steps import training_steps
from pipeline.studies.frame import run
from pipeline.studies.pose import stage as pose
from pipeline.studies.recovery import stage
from pipeline.studies.recovery.stage import draw_data, recovery_row
from pipeline.verdicts.run import Run

QUICK = ("outlook", "recovery")  # the others take longer than ten seconds
WORKERS = ("recovery",)  # run with two workers too: all studies run their trials alike
RUN = [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.slow)
    for name in NAMES
]


@pytest.mark.parametrize("name", RUN)
def test_a_study_writes_its_answer_and_equal_bytes_with_any_number_of_workers(
    name,
    project,
):
    run(name)

    first = written()
    tables = {Path(file).stem for file in first if file.endswith(".csv")}
    declared = read_yaml(ROOT / "pipeline/studies" / name / "tables.yaml")
    assert tables <= {table for table in declared if table[0] != "."}
    figures = {f"reports/studies/{name}/{name}.{kind}" for kind in ("png", "svg")}
    assert figures < {*first}
    require_answer(name, first[f"reports/studies/{name}.md"].decode())
    if name in WORKERS:
        text = config.COMPOSED.read_text()
        config.COMPOSED.write_text(text.replace("workers: 1", "workers: 2"))
        shutil.rmtree("reports/studies")  # a trial would not replace its page
        run(name)
        assert written() == first


def require_answer(name: str, text: str) -> None:
    """Require of a page the question, an answer with numbers, one figure and one table."""
    _, _, body = text.partition("\n\n")
    question, *rest = body.split("\n\n")
    assert "?" in question
    assert re.search(r"\d", "".join(rest[:4]))
    assert len(text.split()) <= 1000
    assert text.count(f"]({name}/{name}.png)\n\n**") == 1
    assert "| --- |" in text and "What would change" in text
    assert not re.search(r"\bnan\b|\{|\}", text)


def test_a_factor_that_does_not_exist_is_refused_by_its_name(project):
    options = options_of("robustness", factors={"swing": [1.0]})
    words = "no factor swing; known factors are sway_std"
    with pytest.raises(ConfigError, match=words):
        study_of("robustness").evaluate(None, options)


@pytest.fixture
def without_answer(project) -> None:
    """The project's motion is commanded at every step: the study of recovery has no answer."""
    folder = Path("data/ingest/motion")
    trajectory = contracts.read("trajectory", folder)
    contracts.write(trajectory.assign(**{"v:x": 0.01}), "trajectory", folder)


def test_the_page_states_why_a_dataset_gives_no_answer(without_answer, capsys):
    run("recovery")
    text = Path("reports/studies/recovery.md").read_text()
    assert "No answer for this dataset: " in text and "never rests" in text
    assert "never rests" in capsys.readouterr().out
    assert [*written()] == ["reports/studies/recovery.md"]


def test_a_trial_of_a_study_leaves_an_earlier_page_as_it_is(without_answer):
    page = Path("reports/studies/recovery.md")
    page.parent.mkdir(parents=True)
    page.write_text("earlier")

    run("recovery")

    assert page.read_text() == "earlier" and not page.with_suffix("").exists()
    assert "No answer" in Path("reports/trials/studies/recovery.md").read_text()


def pose_tables(
    tmp_path,
    monkeypatch,
    effects: pd.DataFrame,
) -> dict[str, pd.DataFrame]:
    """Tables of the study of the pose, of a dataset with the table ``pose_effect``."""
    effects = effects.assign(quantity=pose.NORM, windows=40, groups=8)
    effects = effects.assign(spread=0.1, needed=0.2)
    run = Run("ur5", "paper", False, ["a"], ["x"], {}, {}, {"pose_effect": effects})
    (tmp_path / "ur5.json").write_text(run.to_json())
    monkeypatch.setattr(pose, "DATASETS", tmp_path)
    return pose.evaluate(None, None)


EFFECTS = [  # exponent, its interval, power, and the answer
    (1.0, 0.6, 1.4, 0.1, pose.YES),
    (-1.0, -1.4, -0.6, 0.9, pose.FALLS),
    (0.1, -0.2, 0.4, 0.9, pose.NO),
    (0.1, -0.2, 0.6, 0.9, pose.UNKNOWN),
    (0.1, -0.2, 0.4, 0.7, pose.UNKNOWN),
]


def test_the_answer_on_the_pose_follows_from_interval_and_power(tmp_path, monkeypatch):
    columns = ["exponent", "low", "high", "power", "answer"]
    table = pd.DataFrame(EFFECTS, columns=columns)
    answers = [*table.pop("answer")]

    tables = pose_tables(tmp_path, monkeypatch, table.assign(noise=pose.ALL))

    assert tables["pose"]["answer"].tolist() == answers
    assert {*answers} == {*pose.ANSWERS}
    assert [row.answer for row in pose.facts(tables, None)["norm"]] == answers


def test_of_repeated_motions_the_differing_noise_answers_and_the_repeated_stands_beside(
    tmp_path,
    monkeypatch,
):
    parts = [pose.ALL, pose.DIFFERING, pose.REPEATED]
    effects = pd.DataFrame({"noise": parts, "exponent": [0.4, 0.1, 0.5]})
    effects = effects.assign(low=-0.2, high=0.6, power=0.9)
    tables = pose_tables(tmp_path, monkeypatch, effects)
    facts = pose.facts(tables, None)
    (row,) = facts["norm"]

    assert row.noise == pose.DIFFERING
    assert row.exponent == "+0.1 [-0.2, +0.6]"
    assert row.repeated == "+0.5 [-0.2, +0.6]"
    assert [cells[1] for cells in facts["cells"]] == [pose.DIFFERING]
    assert [*tables["pose"]["noise"]] == parts


def with_undeclared_column(evaluate):
    """The study's ``evaluate`` with a column that no table declares."""

    def evaluate_more(*arguments):
        tables = evaluate(*arguments)
        return {name: rows.assign(width=1.0) for name, rows in tables.items()}

    return evaluate_more


def test_a_study_leaves_the_tables_and_page_of_an_earlier_run_where_a_part_of_it_fails(
    project,
    monkeypatch,
):
    study = study_of("outlook")
    run("outlook")
    first = written()

    faults = {
        "facts": (lambda *_: 1 / 0, ZeroDivisionError),
        "draw": (lambda: 1 / 0, ZeroDivisionError),
        "evaluate": (with_undeclared_column(study.evaluate), ContractError),
    }
    for name, (function, error) in faults.items():
        with monkeypatch.context() as patch, pytest.raises(error):
            patch.setattr(study, name, function)
            run("outlook")
        assert written() == first


def option_kinds(options: dict[str, object]) -> dict[str, type]:
    return {key: float if isinstance(x, int) else type(x) for key, x in options.items()}


@pytest.mark.parametrize("name", NAMES)
def test_every_scale_of_a_study_has_the_same_options(name):
    scales = read_yaml(ROOT / f"pipeline/studies/{name}/params.yaml")
    assert {"paper", "smoke"} <= set(scales)
    for options in scales.values():
        assert option_kinds(options) == option_kinds(scales["paper"])


@pytest.fixture
def recorded(project):
    """Return the recorded steps of the project."""
    settings = config.sections("recovery", ROOT / "pipeline/studies/recovery/dvc.yaml")
    return training_steps(settings.dataset.robot, settings.dataset.motion)


def test_drawn_noise_has_the_covariance_of_its_law_and_of_the_measurement(recorded):
    thinned = replace(
        recorded,
        q=recorded.q[:, ::20],
        v=recorded.v[::20],
        noise=recorded.noise[:, ::20],
        known_measurement=recorded.measurement,
    )
    chain = thinned.chain
    q = thinned.q
    v = thinned.v
    model = WishartModel(0.25, Decomposition("pivoted_lu"))
    rng = default_rng(4)
    noise = np.stack([draw_data(model, thinned, rng).noise for _ in range(1500)])

    expected = model.covariance(chain, q, v) + thinned.measurement
    variances = np.diagonal(expected.mean(axis=(0, 1)))
    drawn = noise.var(axis=0).mean(axis=(0, 1))
    assert_allclose(np.sqrt(drawn), np.sqrt(variances), rtol=0.03)

    # the nominal step is the project's: measured minus nominal has the bias of E[B⁻¹]
    due = chain.nominal_step(q, v) / 15  # d/(d − n − 1) − 1 at σ_B = .25
    bias = noise.mean(axis=0) - due
    assert np.abs(bias).max() < 5 * np.sqrt(np.max(expected) / 1500)


@pytest.fixture
def recovered() -> dict:
    """Row of estimates 0.26 ± 0.02 of 0.25, two of which are lost, and of their replicates."""
    rng = default_rng(2)
    estimates = 0.26 + 0.02 * rng.standard_normal(4000)
    replicates = estimates + 0.02 * rng.standard_normal(4000)
    pairs = []
    for first, second in zip(estimates, replicates, strict=True):
        pairs.append(({"a": first}, {"a": second}))
    lost = [None, ({"b": 0.2}, {"b": 0.2})]
    return recovery_row("a", 0.25, [*lost, *pairs])


def test_a_row_has_bias_error_and_coverage_of_the_estimates(recovered):
    assert (recovered["lost"], recovered["datasets"]) == (2, 4000)
    assert recovered["mean"] == pytest.approx(0.26, abs=0.001)
    assert recovered["mean_low"] > 0.25
    assert recovered["bootstrap_standard_error"] == pytest.approx(0.02, rel=0.03)
    # an interval of ±1.96 standard errors about an estimate that is half a standard error off
    assert recovered["coverage"] == pytest.approx(0.92, abs=0.015)


def test_an_estimator_whose_estimates_are_lost_has_no_row_on_the_page(recovered):
    lost = recovery_row("a", 0.25, [None, None])
    rows = [{"estimator": "paper"} | recovered, {"estimator": "moments"} | lost]
    table = pd.DataFrame(rows).assign(parameter="sigma_b")
    facts = stage.facts({"recovery": table}, options_of("recovery"))
    assert [*map(len, facts["estimators"].values())] == [1, 0]


@pytest.mark.parametrize("name", ["additive", "gaussian"])
def test_a_known_law_has_the_recorded_variance_and_the_names_of_the_estimates(
    recorded,
    name,
):
    (case,) = stage.known_laws(recorded, options_of("recovery", estimators={name: []}))
    law = build_model(case.truth.parameters)
    covariance = law.covariance(recorded.chain, recorded.q, recorded.v)
    estimates = estimate(recorded, case.estimators["–"]).estimates

    total = np.trace(covariance.mean(axis=(0, 1)))
    of_noise = np.trace(mean_covariance(recorded.noise))
    assert total == pytest.approx(of_noise, rel=1e-6)
    assert {*case.truth.values} == {*estimates}
