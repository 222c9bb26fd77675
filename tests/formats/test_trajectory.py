from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.trajectory import COLUMNS, read_trajectory, write_trajectory


def trajectory(rows: int = 321) -> pd.DataFrame:
    table = np.random.default_rng(1).normal(0, 0.5, (rows, 7))
    table[:, 0] = np.arange(rows) / 100
    return pd.DataFrame(table, columns=COLUMNS)


def families(table: pd.DataFrame) -> pd.DataFrame:
    """As the table is read: the rows of the task as families of columns."""
    names = ["t", *(f"{family}:{row}" for family in "xv" for row in ("x", "z", "phi"))]
    return table.set_axis(names, axis=1)


def test_written_trajectories_read_back_bit_for_bit_in_any_order_of_columns(tmp_path):
    write_trajectory(tmp_path / "t.csv", families(trajectory()))
    assert (tmp_path / "t.csv").read_text().startswith("t,x,z,phi,vx,vz,vphi\n0.0,")
    pd.testing.assert_frame_equal(
        read_trajectory(tmp_path / "t.csv"), families(trajectory()), check_exact=True
    )
    trajectory()[COLUMNS[::-1]].to_csv(tmp_path / "t.csv", index=False)
    pd.testing.assert_frame_equal(
        read_trajectory(tmp_path / "t.csv"), families(trajectory()), check_exact=True
    )


def test_the_joints_may_stand_beside_the_pose_or_alone(tmp_path):
    joints = {"q:a": np.linspace(0, 1, 9), "q:b": np.linspace(2, 3, 9)}
    both = families(trajectory(9)).assign(**joints)
    for written in (both, both[["t", "q:a", "q:b"]]):
        write_trajectory(tmp_path / "t.csv", written)
        read = read_trajectory(tmp_path / "t.csv")
        pd.testing.assert_frame_equal(read, written, check_exact=True)
    # beside the joints a pose is whole, or there is none
    both.drop(columns="x:z").rename(columns={"x:x": "x", "x:phi": "phi"}).to_csv(tmp_path / "t.csv")
    with pytest.raises(RecordingError, match="must name z"):
        read_trajectory(tmp_path / "t.csv")


@pytest.mark.parametrize(
    ("row", "column", "value", "line", "words"),
    [
        (3, "vz", "nan", 5, "column 6 has no number"),
        (3, "x", "inf", 5, "'inf'"),
        (3, "phi", "", 5, "column 4 has no number"),
        (3, "phi", "O.1", 5, "'O.1'"),
        (5, "t", "0.0502", 7, "steps must be equal"),
        (5, "t", "0.03", 7, "steps must be equal"),
    ],
)
def test_values_that_no_robot_can_follow_are_refused_with_their_line(
    tmp_path, row, column, value, line, words
):
    table = trajectory(20).astype(str)
    table.loc[row, column] = value
    table.to_csv(tmp_path / "t.csv", index=False)
    with pytest.raises(RecordingError) as caught:
        read_trajectory(tmp_path / "t.csv")
    assert words in caught.value.message
    assert caught.value.evidence["line"] == line


@pytest.mark.parametrize(
    "content",
    [
        "",
        "t,x\n0,1\n",
        ",".join(COLUMNS) + "\n",
        ",".join(COLUMNS) + "\n0,0,0,0,0,0,0\n",
        "t,x,z,phi,vx,vz\n0,0,0,0,0,0\n",
    ],
)
def test_headers_without_their_columns_or_rows_are_refused(tmp_path, content):
    (tmp_path / "t.csv").write_text(content)
    with pytest.raises(RecordingError):
        read_trajectory(tmp_path / "t.csv")


def test_a_joint_that_is_named_twice_is_refused(tmp_path):
    (tmp_path / "t.csv").write_text("t,q:a,q:a\n0,1,2\n0.1,1,2\n")
    with pytest.raises(RecordingError, match="must name q:a once"):
        read_trajectory(tmp_path / "t.csv")
