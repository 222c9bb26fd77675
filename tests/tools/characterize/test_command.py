"""From a folder of logs to the model card and the exported model in one command, and what is asked
for where the files cannot tell.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from joint_logs import write_movement
from source_code import ROOT

from pipeline.core import config
from pipeline.core.errors import ConfigError
from pipeline.models import load
from pipeline.tools.characterize import command


@pytest.fixture
def logs(tmp_path, monkeypatch) -> Path:
    """Logs of a UR5, in a project whose option files are its own."""
    project = tmp_path / "project"
    (project / "data/raw").mkdir(parents=True)
    (project / "conf").mkdir()
    for file in (ROOT / "pipeline/conf").iterdir():
        target = project / "conf" / file.name
        if file.name != "dataset":
            target.symlink_to(file)
    (project / "conf/dataset").mkdir()
    monkeypatch.setattr(config, "CONF", project / "conf")
    for name in ("pipeline", "dvc.yaml", "params.yaml"):
        (project / name).symlink_to(ROOT / name)
    monkeypatch.chdir(project)
    folder = tmp_path / "bench"
    write_movement(folder / "move_1", 12, noise=5e-5)
    write_movement(folder / "move_2", 5, noise=5e-5, seed=2, offset=0.2)
    return folder


@pytest.mark.slow
def test_logs_become_a_card_and_a_model_in_one_command(logs, capsys):
    urdf = str(ROOT / "pipeline/arm/ur5.urdf")
    answers = ["--set", "about.licence=none", "--set", "motion.pose_noise=5e-5"]
    command.run([str(logs), "--urdf", urdf, "--scale", "smoke", "--model", "scaled_all", *answers])
    printed = capsys.readouterr().out
    assert "took robot.tool: flange" in printed and "odel for another motion" in printed
    card = Path("reports/bench/model_card.md").read_text()
    assert card.index("odel for another motion") < card.index("## Why")
    assert Path("reports/bench/noise_quantiles.png").is_file()
    record = json.loads(Path("data/export/bench_scaled_all.json").read_text())
    assert record["motions"] == 4 and record["dataset"] == "bench"
    model = load(Path("data/export/bench_scaled_all.json"))
    std = np.sqrt(np.diag(model.covariance_of_joint_step(np.zeros(6))))
    np.testing.assert_allclose(std, np.sqrt(2) * 5e-5, rtol=0.2)
    # the user's own experiment is as it was
    assert not Path("data/ingest").exists()


def test_a_folder_that_is_not_there_is_refused(logs):
    with pytest.raises(ConfigError, match="no such folder"):
        command.run([str(logs / "absent")])
