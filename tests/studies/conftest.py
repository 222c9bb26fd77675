"""A project with recordings drawn from a known model, in which a study can run."""

from __future__ import annotations

from pathlib import Path

import pytest
from known_law import write_project

from pipeline.core import contracts


@pytest.fixture
def project(tmp_path, monkeypatch):
    """The chain, joint angles and commanded steps of the recordings in the current directory."""
    monkeypatch.chdir(tmp_path)
    return write_project(tmp_path)


@pytest.fixture
def never_resting(project) -> None:
    """The project, its motion commanded at every step."""
    folder = Path("data/ingest/motion")
    trajectory = contracts.read("trajectory", folder)
    contracts.write(trajectory.assign(**{"v:x": 0.01}), "trajectory", folder)
