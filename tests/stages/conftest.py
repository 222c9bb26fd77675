"""Projects in which stages run: recordings drawn from a known model, and logs of a robot that
repeats its motions.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from joint_logs import MADE_UP, ingested, log_project
from omegaconf import OmegaConf
from recordings_of_law import write_project

from pipeline.configuration import config
from pipeline.stages import ingest

__all__ = ["log_project"]


@pytest.fixture(scope="session")
def known_project(tmp_path_factory) -> tuple:
    """A project of recordings drawn from a known model, to be read only; their chain, joint angles
    and commanded steps.
    """
    folder = tmp_path_factory.mktemp("known")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, *write_project(folder)


@pytest.fixture
def project(known_project, tmp_path, monkeypatch) -> None:
    """A copy of it as the current directory."""
    shutil.copytree(known_project[0], tmp_path, symlinks=True, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


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
def read(log_project) -> Callable[..., tuple[list[str], np.ndarray]]:
    """A way to read logs of the made-up robot, with these options of ``joint_log``; its takes."""

    def takes(recordings: Path, *, steps: int = 140, robot=None, **options):
        overrides = {"joint_log": MADE_UP | options, "motion": {"steps": steps}}
        overrides |= {} if robot is None else {"robot": robot}
        log_project("ur5_planar", recordings, **overrides)
        ingest.run("motion")
        return ingested()

    return takes
