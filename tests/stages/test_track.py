"""The stage: takes beyond a limit are left out of all that follows and named, and those within it
are as they were.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf

from pipeline.core import contracts
from pipeline.stages import articulate, track

pytestmark = pytest.mark.slow


@pytest.fixture
def project(reproduced, tmp_path, monkeypatch):
    """A reproduced project to edit, as the current folder."""
    folder = tmp_path / "project"
    shutil.copytree(
        reproduced, folder, symlinks=True, ignore=shutil.ignore_patterns("cache", ".git")
    )
    for file in folder.rglob("*"):  # what DVC linked from its cache is read-only
        if file.is_file():
            file.chmod(0o644)
    monkeypatch.chdir(folder)


def read(name: str, stage: str) -> pd.DataFrame:
    return contracts.read(name, Path("data") / stage)


def test_the_limits_of_the_youbot_leave_out_none_of_its_takes(project):
    takes = read("takes", "track")
    assert not takes["left_out"].any() and takes["limit"].notna().any()
    quality = read("quality", "track")
    left_out = quality.loc[quality["quantity"] == "left_out", "value"]
    assert (left_out == 0).sum() == takes["take"].nunique()


def test_a_gap_and_a_bad_clock_leave_two_takes_out_of_all_that_follows(project, capsys):
    before = read("joints", "track")
    file = Path("data/ingest/motion/markers.parquet")
    markers = pd.read_parquet(file)
    hidden = (markers["take"] == "train_001") & (markers["link"] > 0)  # one alone is solved
    markers.loc[hidden & markers["k"].between(50, 90), ["x", "y", "z"]] = np.nan
    markers.to_parquet(file, index=False)
    # the camera's clock loses seven in a hundred, where the estimate to first order still tells
    file = Path("data/ingest/depth/frames.parquet")
    frames = pd.read_parquet(file)
    frames.loc[frames["take"] == "test_001", "t"] *= 0.93
    frames.to_parquet(file, index=False)
    track.run()
    said = capsys.readouterr().out
    for words in ("2 of ", "train_001 (", "longest_gap 41 beyond 20)", "test_001 (clock_drift 0."):
        assert words in said
    stay = before[~before["take"].isin(["train_001", "test_001"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(read("joints", "track"), stay)
    assert set(read("takes", "track").query("left_out")["take"]) == {"train_001", "test_001"}
    # of three test takes the noise at the ends of the motion needs more frames
    config = OmegaConf.load("data/config.yaml")
    config.articulation.noise_window = 4
    OmegaConf.save(config, "data/config.yaml")
    articulate.run()
    kept = set(stay.loc[stay["part"] == "test", "take"])
    assert set(read("angles", "articulate")["take"]) == kept


def test_a_take_that_tracks_badly_is_left_out_by_its_residual(project):
    markers = read("markers", "ingest/motion")
    file, rng = Path("data/ingest/motion/markers.parquet"), np.random.default_rng(5)
    shaken = (markers["take"] == "train_002") & (markers["link"] > 0)
    markers.loc[shaken, ["x", "y", "z"]] += rng.normal(0, 1.5e-3, (shaken.sum(), 3))
    markers.to_parquet(file, index=False)
    track.run()
    assert set(read("takes", "track").query("beyond")["measure"]) == {"residual_rms"}
    assert set(read("takes", "track").query("left_out")["take"]) == {"train_002"}
    config = OmegaConf.load("data/config.yaml")
    config.dataset.limits = {}
    OmegaConf.save(config, "data/config.yaml")
    track.run()
    assert "train_002" in set(read("joints", "track")["take"])
