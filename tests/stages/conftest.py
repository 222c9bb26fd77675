"""Projects in which stages run: recordings drawn from a known model, and logs of a robot that
repeats its motions.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from joint_logs import MADE_UP, ROOT, ingested
from known_law import write_project
from omegaconf import OmegaConf

from pipeline.core import config
from pipeline.stages import ingest


@pytest.fixture
def project(tmp_path, monkeypatch):
    """The chain, joint angles and commanded steps of the recordings in the current directory."""
    monkeypatch.chdir(tmp_path)
    return write_project(tmp_path)


@pytest.fixture
def choose() -> Callable[..., None]:
    """A way to change params.yaml in the current directory and compose again."""

    def chosen(**changes) -> None:
        params = OmegaConf.load("params.yaml")
        params.update(changes)
        OmegaConf.save(params, "params.yaml")
        config.write_config(Path("params.yaml"))

    return chosen


@pytest.fixture
def log_project(tmp_path, monkeypatch) -> Callable[..., None]:
    """An empty project in which stages can run, and a way to choose its dataset."""
    folder = tmp_path / "project"
    folder.mkdir()
    for name in ("pipeline", "dvc.yaml"):
        (folder / name).symlink_to(ROOT / name)
    monkeypatch.chdir(folder)

    def chosen(dataset: str, recordings: Path, **overrides) -> None:
        params = OmegaConf.load(ROOT / "params.yaml")
        overrides = {"dataset": {"recordings": str(recordings)} | overrides}
        params.update({"dataset": dataset, "scale": "smoke", "overrides": overrides})
        OmegaConf.save(params, folder / "params.yaml")
        config.write_config(Path("params.yaml"))

    return chosen


@pytest.fixture
def read(log_project) -> Callable[..., tuple[list[str], np.ndarray]]:
    """A way to read logs of the made-up robot, with these options of ``joint_log``; its takes."""

    def takes(recordings: Path, *, steps: int = 140, robot=None, **options):
        overrides = {"joint_log": MADE_UP | options, "motion": {"steps": steps}}
        overrides |= {} if robot is None else {"robot": robot}
        log_project("ur5_planar", recordings, **overrides)
        ingest.run("motion")
        return ingested()

    return takes
