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


@pytest.mark.parametrize(
    ("row", "column", "value", "words"),
    [
        (3, "vz", "nan", "column 6 has no number"),
        (3, "phi", "O.1", "'O.1'"),
        (3, "t", "0.1002", "steps must be equal"),
        (3, "t", "0.03", "steps must be equal"),
    ],
)
def test_values_that_no_robot_can_follow_are_refused_with_their_line(
    tmp_path, row, column, value, words
):
    table = trajectory(20).astype(str)
    table.loc[row, column] = value
    table.to_csv(tmp_path / "t.csv", index=False)
    with pytest.raises(RecordingError) as caught:
        read_trajectory(tmp_path / "t.csv")
    assert words in caught.value.message and caught.value.evidence["line"] == row + 2


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "empty"),
        ("t,x\n0,1\n", "must name z"),
        (",".join(COLUMNS) + "\n0,0,0,0,0,0,0\n", "at least two rows"),
        ("t,x,z,phi,vx,vz\n0,0,0,0,0,0\n", "must name vphi"),
        ("t,q:a,q:a\n0,1,2\n0.1,1,2\n", "must name q:a once"),
        ("t,q:a\n0,3.1\n0.1,-3.1\n0.2,-3\n", "q:a jumps by -6.2 rad"),
        ("t,q:a\n0,3.1\n0.1,3", "no line end"),
    ],
)
def test_a_file_that_is_no_trajectory_is_refused(tmp_path, content, words):
    (tmp_path / "t.csv").write_text(content)
    with pytest.raises(RecordingError, match=words):
        read_trajectory(tmp_path / "t.csv")
