"""Projects in which stages run: recordings drawn from a known model, and logs of a robot that
repeats its motions.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from joint_logs import ROOT
from known_law import write_project
from omegaconf import OmegaConf

from pipeline.core import config


@pytest.fixture
def project(tmp_path, monkeypatch):
    """The chain, joint angles and commanded steps of the recordings in the current directory."""
    monkeypatch.chdir(tmp_path)
    return write_project(tmp_path)


@pytest.fixture
def log_project(tmp_path, monkeypatch) -> Callable[..., None]:
    """An empty project in which stages can run, and a way to choose its dataset."""
    folder = tmp_path / "project"
    folder.mkdir()
    for name in ("pipeline", "dvc.yaml"):
        (folder / name).symlink_to(ROOT / name)
    monkeypatch.chdir(folder)

    def choose(dataset: str, recordings: Path, **overrides) -> None:
        params = OmegaConf.load(ROOT / "params.yaml")
        params.update(
            {
                "dataset": dataset,
                "scale": "smoke",
                "overrides": {"dataset": {"recordings": str(recordings)} | overrides},
            }
        )
        OmegaConf.save(params, folder / "params.yaml")
        config.write_config(Path("params.yaml"))

    return choose
