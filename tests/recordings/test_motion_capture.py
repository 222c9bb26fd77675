"""Takes of motion capture and the commanded trajectory as tables, in every form, or refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from marker_takes import (
    MOUNT,
    STEPS,
    TEMPLATE,
    bodies_of,
    dataset,
    markers_of,
    tracked,
    written,
)
from sample_options import made
from space_arms import LWR4, UR5, YOUBOT, motion

from pipeline.arm.model import arm_of, chain_of
from pipeline.core.columns import members, spread, values
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Body, Dataset, Motion, Pose
from pipeline.formats.trajectory import write_trajectory
from pipeline.recordings.motion_capture import find_takes, marker_rows, trajectory_rows

ARM, JOINTS = arm_of(YOUBOT), np.linspace([1.6, -4.8, 2.0], [2.2, -4.2, 2.6], STEPS + 1)


def read(file: Path, part: str = "training", **mocap):
    """Rows of the take in ``file``, and a function of its quality."""
    rows, quality = marker_rows("t", file, part, dataset(**mocap))
    return rows, {row["quantity"]: row["value"] for row in quality}.__getitem__


def require_angles(rows: pd.DataFrame) -> None:
    np.testing.assert_allclose(tracked(rows, ARM).q, JOINTS, rtol=0, atol=5e-5)


def test_markers_and_bodies_give_back_the_joints_that_carried_them(tmp_path):
    rows, count = read(written(tmp_path, markers_of(ARM, JOINTS), first=72210))
    require_angles(rows)
    assert count("missing_samples") == count("unlabelled_markers") == 0
    bodies = {link: Body(f"B{j}", MOUNT) for j, link in enumerate(TEMPLATE, 1)}
    rows, _ = read(written(tmp_path, {}, bodies_of(ARM, JOINTS)), bodies=bodies)
    require_angles(rows)
    assert np.nanmax(tracked(rows, ARM).residual) < 1e-5
    # the control: the same bodies, taken to be mounted otherwise
    mount = Pose(MOUNT.position, [0.3, -0.1, 1.1])
    other = {link: Body(body.name, mount) for link, body in bodies.items()}
    rows, _ = read(tmp_path / "t.csv", bodies=other)
    assert np.abs(tracked(rows, ARM).q - JOINTS).max() > 0.01


def test_bodies_and_markers_mix_link_by_link_and_lost_poses_are_missing_markers(tmp_path):
    bodies, markers = bodies_of(ARM, JOINTS), markers_of(ARM, JOINTS)
    bodies["B2"].position[5:8] = bodies["B2"].quaternion[5:8] = np.nan
    bodies["B2"].quaternion[20:] *= -1  # the same rotations
    kept = {name: points for name, points in markers.items() if not name.endswith("2")}
    file = written(tmp_path, kept | {"stray": markers["a2"]}, bodies)
    rows, count = read(file, "test", bodies={"link2": Body("B2", MOUNT)})
    require_angles(rows)
    assert (count("missing_samples"), count("unlabelled_markers")) == (9, 0)
    assert count("missing_poses") == 3


def test_names_stand_without_their_asset_unless_two_assets_share_them(tmp_path):
    markers = {f"Arm:{name}": points for name, points in markers_of(ARM, JOINTS).items()}
    require_angles(read(written(tmp_path, markers))[0])
    file = written(tmp_path, markers | {"Leg:a1": markers["Arm:a1"] + 1})
    with pytest.raises(RecordingError, match="'a1' may be Arm:a1 or Leg:a1"):
        read(file)
    first = {"Arm:a1" if name == "a1" else name: at for name, at in TEMPLATE["link1"].items()}
    rows, count = read(file, markers=TEMPLATE | {"link1": first})
    require_angles(rows)
    assert count("unlabelled_markers") == 1


def test_a_body_that_the_take_lacks_or_that_has_no_link_is_named(tmp_path):
    file = written(tmp_path, markers_of(ARM, JOINTS), bodies_of(ARM, JOINTS))
    words = "no rigid body named X in the take; it has B1, B2, B3"
    with pytest.raises(RecordingError, match=words):
        read(file, bodies={"link1": Body("X", MOUNT)})
    with pytest.raises(ConfigError, match="no link arm; there are link1, link2, link3"):
        read(file, bodies={"arm": Body("B1", MOUNT)})
    with pytest.raises(RecordingError, match="no marker named x9 in the take; it has a1, a2"):
        read(file, markers=TEMPLATE | {"link1": {"x9": [0.0, 0.0, 0.0]}})


def test_takes_of_another_rate_or_length_are_refused(tmp_path):
    markers = markers_of(ARM, JOINTS)
    with pytest.raises(RecordingError, match="at 120"):
        read(written(tmp_path, markers, rate=120.0))
    file = written(tmp_path, markers)
    file.write_bytes(b"".join(file.read_bytes().splitlines(keepends=True)[:-1]))
    with pytest.raises(RecordingError, match=r"spans 40 frames .* the motion has 41"):
        read(file)


def test_takes_are_found_by_part_and_two_of_one_name_are_refused(tmp_path):
    for name in ("train_1.csv", "train_2.c3d", "test_1.csv"):
        (tmp_path / name).touch()
    result = find_takes(tmp_path, dataset(training="train_*", test="test_*").mocap)
    assert [(name, file.name, part) for name, file, part in result] == [
        ("train_1", "train_1.csv", "training"),
        ("train_2", "train_2.c3d", "training"),
        ("test_1", "test_1.csv", "test"),
    ]
    (tmp_path / "train_1.c3d").touch()
    for error, patterns, words in (
        (RecordingError, {"training": "train_*"}, "two recordings are named 'train_1'"),
        (RecordingError, {"training": "train_2*", "test": "none_*"}, "no test take matches"),
        (RecordingError, {"training": "train_2*", "test": "*_2*"}, "has the same name 'train_2'"),
        (ConfigError, {"training": "/takes/*"}, "must be a relative path"),
    ):
        with pytest.raises(error, match=words):
            find_takes(tmp_path, dataset(**patterns).mocap)
    (tmp_path / "test_1.csv").rename(tmp_path / "t\udce9.csv")
    with pytest.raises(RecordingError, match="is not UTF-8"):
        find_takes(tmp_path, dataset(training="t*.csv").mocap)
    (tmp_path / "link_1.csv").symlink_to("nowhere")  # its reader names it
    assert len(find_takes(tmp_path, dataset(training="link_*").mocap)) == 1


GRID = 30
TIME = np.arange(GRID + 1) / 100


@pytest.fixture
def file(tmp_path):
    table = pd.DataFrame({"t": TIME} | spread("q", UR5.joints, motion(GRID + 1)))
    write_trajectory(tmp_path / "t.csv", table)
    return tmp_path / "t.csv"


def commanded(robot=UR5, rate: float = 100.0) -> Dataset:
    return made(Dataset, robot=robot, motion=Motion(rate, GRID))


def test_the_steps_take_the_arm_from_each_commanded_pose_to_the_next(file):
    table, chain, q = trajectory_rows(file, commanded()), chain_of(UR5), motion(GRID + 1)
    steps = chain.displacement(chain.pose(q[:-1]), chain.pose(q[1:]))
    np.testing.assert_allclose(values(table, "v")[:-1] / 100, steps, atol=1e-12)
    assert members(table, "x") == chain.task and members(table, "u") == ()
    # an arm of more joints than rows is told its joints too
    table = trajectory_rows(file, commanded(replace(UR5, task=["x", "y", "z"])))
    assert values(table, "v").shape == (GRID + 1, 3)
    np.testing.assert_allclose(values(table, "u")[:-1] / 100, np.diff(q, axis=0), atol=1e-12)


@pytest.mark.parametrize(
    ("robot", "rate", "words"),
    [(LWR4, 100.0, "the trajectory has the joints joint_1"), (UR5, 50.0, "31 at 50")],
)
def test_another_arms_or_another_grids_trajectory_is_refused(file, robot, rate, words):
    with pytest.raises(RecordingError, match=words):
        trajectory_rows(file, commanded(robot, rate))
