"""The study on frames whose errors are known: the slopes, the bins and the filters of either end
stand in its tables and on its page.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from known_law import JOINTS
from omegaconf import OmegaConf

from pipeline.core import config, contracts
from pipeline.core.columns import spread, values
from pipeline.perception.depth_state import ALL, NEAR_A_SAMPLE
from pipeline.studies.depth import stage
from pipeline.studies.depth.compare import BINS, error_bins

SLOPES = {"commanded": -1.0, "fitted": 0.0}
NOISE = 2e-3  # rad
PAGE = Path("reports/studies/depth.md")


def angles(end: str) -> pd.DataFrame:
    """A frame at every fifth step of the test takes, whose error on the deviation from the mean of
    the training takes has the slope of ``end``.
    """
    joints, rng = contracts.read("joints", Path("data/track")), np.random.default_rng(6)
    mean = joints[joints.part == "training"].groupby("k")[[f"q:{name}" for name in JOINTS]].mean()
    rows = joints[(joints.part == "test") & (joints.k % 5 == 0)]
    q = values(rows, "q")
    y = q + SLOPES[end] * (q - mean.loc[rows.k].to_numpy()) + rng.normal(scale=NOISE, size=q.shape)
    nodes = dict.fromkeys(("x2", "z2", "x3", "z3", "xe", "ze"), 0.0)
    table = rows[["take", "part", "t"]].assign(frame=rows.k, points=1000, objective=0.01, **nodes)
    return table.assign(**spread("q", JOINTS, y)).reset_index(drop=True)


@pytest.fixture
def studied(project, monkeypatch) -> None:
    """The study, run on the frames of :func:`angles`."""
    composed = OmegaConf.load(config.COMPOSED)
    composed.articulation.noise_window = 1
    OmegaConf.save(composed, config.COMPOSED)
    Path("data/articulate").mkdir()
    contracts.write(angles("commanded"), "angles", Path("data/articulate"))
    monkeypatch.setattr(stage, "depth_takes", list)
    monkeypatch.setattr(
        stage, "articulated", lambda _, __, options, *___: angles(options.end_point)
    )
    stage.run()


def read(name: str) -> pd.DataFrame:
    return contracts.read(name, Path("data/studies/depth"), stage.HERE / "tables.yaml")


def test_slopes_and_filters_of_either_end_stand_in_the_tables_and_on_the_page(studied):
    rows = read("error_slopes")
    assert len(rows) == 2 * 2 * len(JOINTS)
    far = np.abs(rows["slope"] - rows["end"].map(SLOPES)) / rows["standard_error"]
    assert far.max() < 4
    # every frame is at a sample
    assert (
        rows.groupby("frames")["number"].sum()[ALL]
        == rows.groupby("frames")["number"].sum()[NEAR_A_SAMPLE]
    )
    filters = read("filters").set_index(["end", "joint"])
    assert set(filters.index) == {(end, joint) for end in SLOPES for joint in JOINTS}
    # a camera that takes deviations back follows the arm the worse
    error = filters["error"].unstack("end")
    assert np.all(error["commanded"] > error["fitted"])
    text = PAGE.read_text()
    assert f"With the commanded end the error falls with the deviation, by more than {2} " in text
    assert f"in {len(JOINTS)} of {len(JOINTS)} joints" in text and "in 0 of 3 joints" in text
    assert "## Filters" in text and "depth/figures/depth_error.png" in text


def test_without_a_depth_camera_the_page_says_so(project, capsys):
    stage.run()
    assert "no depth camera" in PAGE.read_text()
    assert "nothing to do" in capsys.readouterr().out


def test_bins_hold_as_many_frames_each_in_the_order_of_the_deviation():
    d = np.random.default_rng(8).normal(size=(400, 1))
    table = pd.DataFrame({"t": np.arange(400) / 100} | {"d:a": d[:, 0], "e:a": -0.5 * d[:, 0]})
    late = table.assign(t=table["t"] + 0.005, **{"e:a": 9.0})
    bins = error_bins(pd.concat([table, late], ignore_index=True), 0.01)
    assert len(bins) == BINS and bins["deviation"].is_monotonic_increasing
    np.testing.assert_allclose(bins["error"], -0.5 * bins["deviation"])
    assert bins["deviation"].mean() == pytest.approx(d.mean())
