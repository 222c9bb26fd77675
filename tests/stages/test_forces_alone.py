"""A dataset without a robot goes through every stage of the paper, and its six rows are held
against the model.
"""

from __future__ import annotations

import json
import shutil
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Dataset
from pipeline.verdicts.decision import NO_EVIDENCE
from pipeline.verdicts.run import read_run

ROOT = Path(__file__).parents[2]
STAGES = ["record towing", *(f"ingest {part}" for part in ("motion", "depth", "force"))]
STAGES += ["track", "articulate", "fit additive", "filter additive", "fit gaussian"]
STAGES += ["filter gaussian", "predict", "wrench", "readings", "score", "figures", "publish"]
STAGES += ["report"]
PARAMS = """dataset: towing
models: [additive, gaussian]
filter: systematic
articulation: least_squares
simulation: one_step
wrench: paper
scale: smoke
compute: serial
seed: 5
overrides: {}
"""


@pytest.mark.slow
def test_forces_alone_go_through_every_stage_and_are_scored_on_all_rows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("pipeline", "dvc.yaml", "reports/claims.yaml"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).symlink_to(ROOT / name)
    raw = Path("data/raw/towing")
    raw.mkdir(parents=True)
    shutil.copy(ROOT / raw / "dvc.yaml", raw)
    Path("params.yaml").write_text(PARAMS)
    config.write_config(Path("params.yaml"))
    for stage in STAGES:
        name, _, item = stage.partition(" ")
        import_module(f"pipeline.stages.{name}").run(*filter(None, [item]))
    recorded = [file.name for file in (raw / "recordings/force").iterdir()]
    assert sorted(recorded) == ["T3.csv", "T4.csv", "T6.csv"]
    forces = contracts.read("force", Path("data/ingest/force"))
    assert list(forces)[2:] == ["fx", "fy", "fz", "mx", "my", "mz"]
    run = read_run(Path("reports/datasets/towing.json"))
    assert run.synthetic and run.joints == [] == list(run.task)
    moments = run.tables["force_moments"].set_index(["configuration", "source"])
    for name in ("T3", "T4", "T6"):
        measured, modelled = (moments.loc[(name, s)] for s in ("measured", "modelled"))
        rows = ["fx", "fy", "fz", "mx", "my", "mz"]
        size = np.sqrt([measured[f"var_{row}"] for row in rows])
        # a record of some seconds has few independent samples
        assert np.all(np.abs(measured[rows] - modelled[rows]) < 2 * size), name
    sigma = run.tables["sigma_s"].set_index(["system_class", "form"])
    assert sigma.loc[("T6", "full")].notna().all()
    assert pd.isna(sigma.loc[("study", "full"), "s66"].iloc[0])
    drawn = json.loads(Path("reports/towing/captions.json").read_text())
    assert {"wrench_planes", "wrench_marginals"} < set(drawn) and "wrench_density" not in drawn
    decided = json.loads(Path("reports/towing/claims.json").read_text())["claims"]
    verdicts = [c["datasets"]["towing"] for c in decided if "towing" in c["datasets"]]
    of_joints = [verdict["verdict"] for verdict in verdicts if not verdict["cases"]]
    assert of_joints and {*of_joints} == {NO_EVIDENCE}


def test_a_dataset_without_a_robot_has_forces_and_nothing_that_sees_a_robot():
    with pytest.raises(ConfigError, match="robot or a force transducer"):
        Dataset("t", ".", None, None)
    with pytest.raises(ConfigError, match="there is no trajectory"):
        Dataset("t", ".", None, None, trajectory="t.csv")
