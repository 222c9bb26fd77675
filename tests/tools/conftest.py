"""A project's root to write datasets into, and a UR5's logs to write one from."""

from pathlib import Path

import numpy as np
import pytest
from joint_logs import log_project, there_and_back
from written_logs import write_joint_log

from pipeline.configuration import config, datasheet
from pipeline.formats.joints.log import JointLog

__all__ = ["log_project"]
FROM = np.array([0.3, -1.2, 1.4, -1.0, -1.2, 0.2])  # rad
TO = FROM + np.array([0.4, 0.3, -0.3, 0.2, 0.2, 0.5])  # rad


@pytest.fixture
def root(tmp_path, monkeypatch) -> Path:
    """An empty project that is worked in."""
    folder = tmp_path / "project"
    (folder / "conf/dataset").mkdir(parents=True)
    (folder / "params.yaml").write_text("dataset: youbot\n")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(config, "CONF", folder / "conf")
    monkeypatch.setattr(datasheet, "DATASHEETS", folder / "data/raw")
    return folder


@pytest.fixture
def logs(tmp_path) -> Path:
    """Two movements of a UR5, each three times there and back, as a folder of three tables each."""
    target = there_and_back(FROM, TO, rest=30, times=3)
    speed = np.diff(target, axis=0, prepend=target[:1]) / 0.01
    rows = np.arange(len(target))

    for number, name in enumerate(("No1_slow", "No2_slow")):
        folder = tmp_path / "logs" / name
        folder.mkdir(parents=True)
        # equal samples would be a copy
        deviation = number * 1e-3 * np.sin(rows / 7)[:, None]
        tables = {
            "q_actual": target + deviation,
            "q_target": target,
            "qd_target": speed,
        }
        for signal, values in tables.items():
            log = JointLog(rows / 100, {"actual": values}, {})
            write_joint_log(folder / f"{signal}.csv", log)

    (tmp_path / "logs/rest_3").mkdir()
    force = JointLog(np.arange(30) / 200, {"actual": np.zeros((30, 6))}, {})
    write_joint_log(tmp_path / "logs/rest_3/force.csv", force)
    (tmp_path / "logs/LICENSE.txt").write_text("  MIT License\n\nCopyright\n")
    return tmp_path / "logs"
