"""``python -m pipeline survey``: what it writes from a run's tables, what it finds again, what it
refuses.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from known_law import ROOT
from omegaconf import OmegaConf
from surveyed_project import write_surveyed_project

from pipeline.__main__ import main
from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError, ContractError
from pipeline.studies.survey.stage import run

TABLES = ROOT / "pipeline/studies/survey/tables.yaml"


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    """Where the experiment has run up to the noise of its instruments."""
    monkeypatch.chdir(tmp_path)
    write_surveyed_project(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_a_survey_that_was_killed_goes_on_and_leaves_its_table_counts_cost_and_figure(
    project, capsys
):
    killed = subprocess.Popen(
        [sys.executable, "-m", "pipeline", "survey", "tiny"], stdout=subprocess.DEVNULL
    )
    # a folder that is still being written to begins with a dot
    points, whole = Path("data/studies/survey/points"), "*/[!.]*/survey.parquet"
    while not list(points.glob(whole)) and killed.poll() is None:
        time.sleep(0.02)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    written = list(points.glob(whole))
    before = {file: file.read_bytes() for file in written}
    assert killed.returncode == -signal.SIGKILL and 1 <= len(written) < 3
    run("tiny")
    said = capsys.readouterr().out
    assert (
        f"conditions: {len(written)} found, {3 - len(written)} computed, 0 unreadable" in said
        and "as in the whole pipeline" in said
    )
    assert {file: file.read_bytes() for file in written} == before
    table = contracts.read("survey", Path("data/studies/survey/tiny"), TABLES)
    assert table["point"].nunique() == 3 and set(table["study"]) == {"motion", "wrench"}
    assert {file.name for file in Path("reports/studies/survey/tiny").iterdir()} == {
        "base_condition.csv",
        "cost.json",
        "survey.png",
        "survey.svg",
        "verdicts.csv",
    }
    cost = json.loads(Path("reports/studies/survey/tiny/cost.json").read_text())
    assert cost["cpu_seconds"] == pytest.approx(table.drop_duplicates("point")["cpu_seconds"].sum())
    run("tiny")
    assert "3 found, 0 computed" in capsys.readouterr().out
    assert contracts.read("survey", Path("data/studies/survey/tiny"), TABLES).equals(table)


def test_a_survey_that_there_is_not_is_refused_with_those_that_there_are(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["pipeline", "survey", "huge"])
    assert main() == 1
    assert (
        "no survey 'huge'; there are base, large, small, tiny [key NAME]" in capsys.readouterr().err
    )


def test_without_the_runs_tables_their_stage_is_named_and_nothing_is_written(project):
    Path("data/articulate/kinect_noise.parquet").unlink()
    with pytest.raises(ContractError, match="kinect_noise"):
        run("tiny")
    assert not Path("data/studies").exists() and not Path("reports/studies/survey").exists()


def test_a_dataset_without_a_laboratory_is_refused(project):
    composed = OmegaConf.load(config.COMPOSED)
    composed.dataset.laboratory = None
    OmegaConf.save(composed, config.COMPOSED)
    with pytest.raises(ConfigError, match="needs the synthetic laboratory"):
        run("tiny")
