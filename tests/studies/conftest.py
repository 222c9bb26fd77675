"""A project with recordings drawn from a known model, in which a study can run."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from recordings_of_law import JOINTS, ROOT, write_project
from space_arms import YOUBOT

from pipeline.arm.model import chain_of
from pipeline.core import contracts
from pipeline.core.columns import spread, triangle
from pipeline.laboratory.causes import sway
from pipeline.laboratory.options import ClockOptions, TrajectoryOptions
from pipeline.studies.simulated import Laboratory, NoiseLaw


@pytest.fixture
def project(tmp_path, monkeypatch):
    """The recordings in the current directory, with a depth camera's noise."""
    monkeypatch.chdir(tmp_path)
    recordings = write_project(tmp_path)
    frames = {"take": "none", "frame": range(4), "t": np.linspace(0.0, 3.2, 4)}
    noise = spread("b", JOINTS, np.full((4, 3), 0.01))
    noise |= triangle("r", JOINTS, np.tile(4e-4 * np.eye(3), (4, 1, 1)))
    Path("data/articulate").mkdir()
    contracts.write(
        pd.DataFrame(frames | noise),
        "kinect_noise",
        Path("data/articulate"),
    )
    Path("data/raw").symlink_to(ROOT / "data/raw")
    Path("reports").mkdir(exist_ok=True)
    Path("reports/datasets").symlink_to(ROOT / "reports/datasets")
    return recordings


@pytest.fixture(scope="session")
def laboratory() -> Laboratory:
    """The youBot on a motion of 1.6 s, with a depth camera of a known law."""
    law = NoiseLaw(
        np.array([0.0, 1.0]),
        np.array([[0.02, 0.0, 0.0], [0.0, 0.04, 0.0]]),
        np.array([1e-4, 4e-4])[:, None, None] * np.eye(3),
    )
    ends = {"folded": (1.8544, -4.5335, 2.2406), "extended": (2.3867, -4.0012, 2.7773)}
    motion = TrajectoryOptions(**ends, duration=1.6, rest=0.1, ramp=0.2)
    noise = np.array([[3.0, -2.0, 0.0], [-2.0, 7.0, -3.0], [0.0, -3.0, 6.0]]) * 1e-8
    parts = (sway.Options(), motion, ClockOptions())
    return Laboratory(chain_of(YOUBOT), ("a", "b", "c"), *parts, noise, law, 2)
