"""``python -m pipeline survey``: what it writes from a run's tables, what it finds again, what it refuses."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from known_law import ROOT, write_project
from omegaconf import OmegaConf

from pipeline import config, contracts
from pipeline.__main__ import main
from pipeline.commands.survey import run
from pipeline.errors import ConfigError, ContractError


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    """Where the experiment has run up to the noise of its instruments."""
    monkeypatch.chdir(tmp_path)
    write_project(tmp_path)
    frames = pd.DataFrame({"take": "none", "frame": range(4), "t": np.linspace(0.0, 3.2, 4)})
    noise = frames.assign(**{f"b{j}": 0.01 for j in (1, 2, 3)}, **{f"r{i}{j}": 4e-4 * (i == j) for i in (1, 2, 3) for j in range(i, 4)})
    contracts.write(noise, "kinect_noise", Path("data/noise"))
    Path("data/raw").symlink_to(ROOT / "data/raw")
    Path("reports").mkdir()
    for name in ("claims.yaml", "datasets"):
        Path("reports", name).symlink_to(ROOT / "reports" / name)
    return tmp_path


@pytest.mark.slow
def test_a_survey_that_was_killed_goes_on_and_leaves_its_table_counts_cost_and_figure(project, capsys):
    killed = subprocess.Popen([sys.executable, "-m", "pipeline", "survey", "tiny"], stdout=subprocess.DEVNULL)
    # a folder that is still being written to begins with a dot
    points, whole = Path("data/survey/points"), "*/[!.]*/survey.parquet"
    while not list(points.glob(whole)) and killed.poll() is None:
        time.sleep(0.02)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    written = list(points.glob(whole))
    before = {file: file.read_bytes() for file in written}
    assert killed.returncode == -signal.SIGKILL and 1 <= len(written) < 3
    run(["tiny"])
    said = capsys.readouterr().out
    assert f"conditions: {len(written)} found, {3 - len(written)} computed, 0 unreadable" in said and "as in the whole pipeline" in said
    assert {file: file.read_bytes() for file in written} == before
    table = contracts.read("survey", Path("data/survey/tiny"))
    assert table["point"].nunique() == 3 and set(table["study"]) == {"motion", "wrench"}
    assert {file.name for file in Path("reports/survey/tiny").iterdir()} == {
        "base_condition.csv", "cost.json", "survey.png", "survey.svg", "verdicts.csv",
    }  # fmt: skip
    cost = json.loads(Path("reports/survey/tiny/cost.json").read_text())
    assert cost["cpu_seconds"] == pytest.approx(table.drop_duplicates("point")["cpu_seconds"].sum())
    run(["tiny"])
    assert "3 found, 0 computed" in capsys.readouterr().out
    assert contracts.read("survey", Path("data/survey/tiny")).equals(table)


def test_a_survey_that_there_is_not_is_refused_with_those_that_there_are(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["pipeline", "survey", "huge"])
    assert main() == 1
    assert "no survey 'huge'; there are base, large, small, tiny [key NAME]" in capsys.readouterr().err


def test_without_the_runs_tables_their_stage_is_named_and_nothing_is_written(project):
    Path("data/noise/kinect_noise.parquet").unlink()
    with pytest.raises(ContractError, match="kinect_noise"):
        run(["tiny"])
    assert not Path("data/survey").exists() and not Path("reports/survey").exists()


def test_a_dataset_without_a_laboratory_is_refused(project):
    composed = OmegaConf.load(config.COMPOSED)
    composed.dataset.twin = None
    OmegaConf.save(composed, config.COMPOSED)
    with pytest.raises(ConfigError, match="needs the synthetic laboratory"):
        run(["tiny"])
