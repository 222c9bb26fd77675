"""Stages on a Dask cluster."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from project_copy import reruns, run, set_parameters

pytestmark = pytest.mark.slow

STAGES = ("data/raw/youbot/dvc.yaml:record", "articulate", "filter@wishart")


def test_stages_write_the_same_bytes_on_a_cluster_and_the_choice_of_it_invalidates_none(
    reproduced, tmp_path
):
    folder = tmp_path / "copy"
    shutil.copytree(reproduced, folder, symlinks=True)
    before = {stage: locked(folder, stage) for stage in STAGES}
    set_parameters(folder, compute="dask", overrides="{compute: {workers: 2}}")
    assert reruns(folder) == set()
    for stage in STAGES:
        done = run("dvc", "repro", "--force", "--single-item", stage, cwd=folder)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "2 worker(s) of tcp://127.0.0.1:" in done.stdout
    assert {stage: locked(folder, stage) for stage in STAGES} == before


def locked(folder: Path, stage: str) -> list[str]:
    """Hashes of what a stage wrote."""
    file, _, name = stage.rpartition(":")
    stages = OmegaConf.to_container(
        OmegaConf.load((folder / (file or "dvc.yaml")).with_name("dvc.lock"))
    )["stages"]
    return [out["md5"] for out in stages[name]["outs"]]
