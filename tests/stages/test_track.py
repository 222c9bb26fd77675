"""The stage track: takes beyond a limit are left out of all that follows and named, and those
within it are as they were.
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

MARKERS = Path("data/ingest/motion/markers.parquet")
FRAMES = Path("data/ingest/depth/frames.parquet")


def read(name: str, stage: str = "track") -> pd.DataFrame:
    return contracts.read(name, Path("data") / stage)


def set_option(key: str, value: object) -> None:
    options = OmegaConf.load("data/config.yaml")
    OmegaConf.update(options, key, value, merge=False)
    OmegaConf.save(options, "data/config.yaml")


@pytest.mark.slow
def test_takes_beyond_a_limit_are_left_out_and_named_and_the_others_stay(
    reproduced, tmp_path, monkeypatch, capsys
):
    for name in ("pipeline", "dvc.yaml"):
        (tmp_path / name).symlink_to(reproduced / name)
    later = shutil.ignore_patterns("raw", "fit", "filter", "figures")
    shutil.copytree(reproduced / "data", tmp_path / "data", ignore=later)
    for file in tmp_path.glob("data/**/*"):  # what DVC linked from its cache is read-only
        if file.is_file():
            file.chmod(0o644)
    monkeypatch.chdir(tmp_path)
    # the limits of the youBot leave out none of its takes
    takes, before, sound = read("takes"), read("joints"), pd.read_parquet(MARKERS)
    assert not takes["left_out"].any() and takes["limit"].notna().any()
    quality = read("quality")
    left_out = quality.loc[quality["quantity"] == "left_out", "value"]
    assert (left_out == 0).sum() == takes["take"].nunique()

    markers = sound.copy()
    # of two links, as one alone is solved
    hidden = (markers["take"] == "train_001") & (markers["link"] > 0)
    markers.loc[hidden & markers["k"].between(50, 90), ["x", "y", "z"]] = np.nan
    markers.to_parquet(MARKERS, index=False)
    # the camera's clock loses seven in a hundred, where the estimate to first order still tells
    in_time, frames = FRAMES.read_bytes(), pd.read_parquet(FRAMES)
    frames.loc[frames["take"] == "test_001", "t"] *= 0.93
    frames.to_parquet(FRAMES, index=False)
    track.run()
    said = capsys.readouterr().out
    for words in ("2 of ", "train_001 (", "longest_gap 41 beyond 20)", "test_001 (clock_drift 0."):
        assert words in said
    stay = before[~before["take"].isin(["train_001", "test_001"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(read("joints"), stay)
    assert set(read("takes").query("left_out")["take"]) == {"train_001", "test_001"}
    # of three test takes the noise at the ends of the motion needs more frames
    set_option("articulation.noise_window", 4)
    articulate.run()
    kept = set(stay.loc[stay["part"] == "test", "take"])
    assert set(read("angles", "articulate")["take"]) == kept

    # one that tracks badly is left out by its residual, and stays where there is no limit
    markers, rng = sound.copy(), np.random.default_rng(5)
    shaken = (markers["take"] == "train_002") & (markers["link"] > 0)
    markers.loc[shaken, ["x", "y", "z"]] += rng.normal(0, 1.5e-3, (shaken.sum(), 3))
    markers.to_parquet(MARKERS, index=False)
    FRAMES.write_bytes(in_time)
    track.run()
    assert set(read("takes").query("beyond")["measure"]) == {"residual_rms"}
    assert set(read("takes").query("left_out")["take"]) == {"train_002"}
    set_option("dataset.limits", {})
    track.run()
    assert "train_002" in set(read("joints")["take"])
