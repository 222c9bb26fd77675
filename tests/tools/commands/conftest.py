"""A project's root to write datasets into, and exports to write them from."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from motive_files import START, random_take
from written_logs import write_joint_log

from pipeline import arm
from pipeline.core import config, datasheet
from pipeline.formats.depth.image import write_depth
from pipeline.formats.depth.index import write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.force.daqft import ForceRecord, write_daqft
from pipeline.formats.joints.log import JointLog
from pipeline.formats.motion.motive import write_motive


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
def exports(tmp_path) -> Path:
    """Takes of motion capture, two of which a depth camera saw, and a force log."""
    folder = tmp_path / "exports"
    for part in ("mocap", "kinect", "force"):
        (folder / part).mkdir(parents=True)
    for name in ("fit_1", "fit_2", "fit_3", "hold_1", "hold_2"):
        write_motive(folder / f"mocap/{name}.csv", random_take(21, body=False), start=START)
    for name in ("hold_1", "hold_2"):
        (folder / "kinect" / name / "depth").mkdir(parents=True)
        files = tuple(f"depth/{number}.png" for number in range(3))
        for file in files:
            write_depth(folder / "kinect" / name / file, np.full((12, 16), 1000, np.uint16))
        write_index(folder / "kinect" / name / "depth.txt", np.arange(3) / 30, files)
    write_intrinsics(folder / "kinect/camera.yaml", Intrinsics(20.0, 20.0, 8.0, 6.0, 16, 12))
    values = np.random.default_rng(1).normal(size=(50, 3))
    write_daqft(
        folder / "force/C1.csv",
        ForceRecord(np.arange(50) / 100, values, values, 100.0, "FT1", START, {}),
    )
    return folder


@pytest.fixture
def joint_exports(tmp_path) -> Path:
    """Movements of six joints, and a folder that holds something else."""
    folder = tmp_path / "logs"
    for number in (1, 2):
        (folder / f"move_{number}").mkdir(parents=True)
        for name in ("q_measured", "q_commanded"):
            log = JointLog(
                np.arange(30) / 125,
                {"actual": np.random.default_rng(number).normal(size=(30, 6))},
                {},
            )
            write_joint_log(folder / f"move_{number}" / f"{name}.csv", log)
    (folder / "rest_3").mkdir()
    write_joint_log(
        folder / "rest_3/force.csv",
        JointLog(np.arange(30) / 200, {"actual": np.zeros((30, 6))}, {}),
    )
    return folder


@pytest.fixture
def space_exports(exports) -> Path:
    """Takes of rigid bodies alone, with a controller's logs of their names, and a URDF."""
    for part in ("mocap", "kinect", "force"):
        shutil.rmtree(exports / part)
    (exports / "logs").mkdir()
    (exports / "mocap").mkdir()
    names = ["time", *(f"measured_{joint}" for joint in "ab"), "target_a"]
    for take in ("move_1", "move_2", "hold_1"):
        recorded = random_take(9)
        recorded.markers.clear()
        write_motive(exports / f"mocap/{take}.csv", recorded, start=START)
        rows = [",".join(f"{0.01 * k + column:.3f}" for column in range(4)) for k in range(9)]
        (exports / f"logs/{take}.csv").write_text("\n".join([",".join(names), *rows, ""]))
    shutil.copy(Path(arm.__file__).parent / "lwr4.urdf", exports / "robot.urdf")
    return exports
