"""Commanded trajectories: read back bit for bit, or refused with the line."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.trajectory import COLUMNS, FAMILIES, read_trajectory, write_trajectory


def trajectory(rows: int = 321) -> pd.DataFrame:
    table = np.random.default_rng(1).normal(0, 0.5, (rows, 7))
    table[:, 0] = np.round(np.arange(rows) / 30, 6)  # as six decimals print equal steps
    return pd.DataFrame(table, columns=COLUMNS)


def test_written_trajectories_read_back_bit_for_bit_in_any_order_of_columns(tmp_path):
    file, families = tmp_path / "t.csv", trajectory().set_axis(FAMILIES, axis=1)
    write_trajectory(file, families)
    assert file.read_text().startswith("t,x,z,phi,vx,vz,vphi\n0.0,")
    pd.testing.assert_frame_equal(read_trajectory(file), families, check_exact=True)
    trajectory()[COLUMNS[::-1]].to_csv(file, index=False)
    pd.testing.assert_frame_equal(read_trajectory(file), families, check_exact=True)


def test_the_joints_may_stand_beside_the_pose_or_alone(tmp_path):
    joints = {"q:a": np.linspace(0, 1, 9), "q:b": np.linspace(2, 3, 9)}
    both, file = trajectory(9).set_axis(FAMILIES, axis=1).assign(**joints), tmp_path / "t.csv"
    for written in (both, both[["t", "q:a", "q:b"]]):
        write_trajectory(file, written.assign(other=1.0))
        pd.testing.assert_frame_equal(read_trajectory(file), written, check_exact=True)
    # beside the joints a pose is whole, or there is none
    both.drop(columns="x:z").rename(columns={"x:x": "x", "x:phi": "phi"}).to_csv(file)
    with pytest.raises(RecordingError, match="must name z"):
        read_trajectory(file)
