"""The stage track: takes beyond a limit are left out of all that follows and named, and those
within it are as they were.
"""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.core import contracts
from pipeline.stages import track

MARKERS = Path("data/ingest/motion/markers.parquet")
FRAMES = Path("data/ingest/depth/frames.parquet")


def read(name: str) -> pd.DataFrame:
    return contracts.read(name, Path("data/track"))


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
    takes, before, markers = read("takes"), read("joints"), pd.read_parquet(MARKERS)
    assert not takes["left_out"].any() and takes["limit"].notna().any()
    quality = read("quality")
    left_out = quality.loc[quality["quantity"] == "left_out", "value"]
    assert (left_out == 0).sum() == takes["take"].nunique()

    # of two links, as one alone is solved
    hidden = (markers["take"] == "train_001") & (markers["link"] > 0)
    markers.loc[hidden & markers["k"].between(50, 90), ["x", "y", "z"]] = np.nan
    markers.to_parquet(MARKERS, index=False)
    # the camera's clock loses seven in a hundred, where the estimate to first order still tells
    frames = pd.read_parquet(FRAMES)
    frames.loc[frames["take"] == "test_001", "t"] *= 0.93
    frames.to_parquet(FRAMES, index=False)
    track.run()
    said = capsys.readouterr().out
    for words in ("2 of ", "train_001 (", "longest_gap 41 beyond 20)", "test_001 (clock_drift 0."):
        assert words in said
    stay = before[~before["take"].isin(["train_001", "test_001"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(read("joints"), stay)
    assert set(read("takes").query("left_out")["take"]) == {"train_001", "test_001"}
