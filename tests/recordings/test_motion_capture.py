"""Takes of motion capture and the commanded trajectory as tables, in every form, or refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_options import made
from marker_takes import (
    MOUNT,
    STEPS,
    TEMPLATE,
    bodies_of,
    dataset,
    markers_of,
    quantity,
    tracked,
    written,
)
from space_arms import LWR4, UR5, motion

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.model import chain_of, load_arm
from pipeline.core.columns import PLANE, columns, members, spread, values
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset, Motion, Robot
from pipeline.core.options.instruments import Body, Pose
from pipeline.formats.trajectory import write_trajectory
from pipeline.recordings.motion_capture import find_takes, marker_rows, trajectory_rows


@pytest.fixture(scope="module")
def arm():
    urdf = Path(__file__).parents[2] / "pipeline/arm/youbot.urdf"
    locked = {"arm_joint_1": 2.9670597283903604, "arm_joint_5": 2.923426497090502}
    return load_arm(str(urdf), ["arm_joint_2", "arm_joint_3", "arm_joint_4"], "arm_tool", locked)


@pytest.fixture(scope="module")
def joints():
    return np.linspace([1.6, -4.8, 2.0], [2.2, -4.2, 2.6], STEPS + 1)


def test_markers_give_back_the_joints_that_carried_them(tmp_path, arm, joints):
    rows, quality = marker_rows(
        "t", written(tmp_path, markers_of(arm, joints), first=72210), "training", dataset()
    )
    np.testing.assert_allclose(tracked(rows, arm).q, joints, rtol=0, atol=5e-5)
    assert quantity(quality, "missing_samples") == quantity(quality, "unlabelled_markers") == 0


def test_rigid_bodies_alone_give_back_the_joints_that_carried_them(tmp_path, arm, joints):
    bodies = {link: Body(f"B{j}", MOUNT) for j, link in enumerate(TEMPLATE, 1)}
    rows, _ = marker_rows(
        "t", written(tmp_path, {}, bodies_of(arm, joints)), "training", dataset(bodies=bodies)
    )
    track = tracked(rows, arm)
    np.testing.assert_allclose(track.q, joints, rtol=0, atol=5e-5)
    assert np.nanmax(track.residual) < 1e-5
    # the control: the same bodies, taken to be mounted otherwise
    other = {
        link: Body(body.name, Pose(MOUNT.position, [0.3, -0.1, 1.1]))
        for link, body in bodies.items()
    }
    rows, _ = marker_rows("t", tmp_path / "t.csv", "training", dataset(bodies=other))
    assert np.abs(tracked(rows, arm).q - joints).max() > 0.01


def test_bodies_and_markers_mix_link_by_link_and_lost_poses_are_missing_markers(
    tmp_path, arm, joints
):
    bodies, markers = bodies_of(arm, joints), markers_of(arm, joints)
    bodies["B2"].position[5:8] = bodies["B2"].quaternion[5:8] = np.nan
    bodies["B2"].quaternion[20:] *= -1  # the same rotations
    kept = {name: points for name, points in markers.items() if not name.endswith("2")} | {
        "stray": markers["a2"]
    }
    rows, quality = marker_rows(
        "t", written(tmp_path, kept, bodies), "test", dataset(bodies={"link2": Body("B2", MOUNT)})
    )
    np.testing.assert_allclose(tracked(rows, arm).q, joints, rtol=0, atol=5e-5)
    assert (quantity(quality, "missing_samples"), quantity(quality, "unlabelled_markers")) == (9, 0)
    assert quantity(quality, "missing_poses") == 3


def test_a_body_that_the_take_lacks_or_that_has_no_link_is_named(tmp_path, arm, joints):
    file = written(tmp_path, markers_of(arm, joints), bodies_of(arm, joints))
    with pytest.raises(
        RecordingError, match="no rigid body named X in the take; it has B1, B2, B3"
    ):
        marker_rows("t", file, "training", dataset(bodies={"link1": Body("X", MOUNT)}))
    with pytest.raises(ConfigError, match="no link arm; there are link1, link2, link3"):
        marker_rows("t", file, "training", dataset(bodies={"arm": Body("B1", MOUNT)}))


def test_frames_that_the_file_skips_are_missing_samples(tmp_path, arm, joints):
    file = written(tmp_path, markers_of(arm, joints))
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:17] + lines[20:]))
    rows, quality = marker_rows("t", file, "training", dataset())
    assert (quantity(quality, "skipped_frames"), quantity(quality, "missing_samples")) == (3, 27)
    assert set(rows.k[rows.x.isna()]) == {10, 11, 12}
    np.testing.assert_allclose(tracked(rows, arm).q, joints, rtol=0, atol=5e-5)


def test_takes_of_another_rate_or_length_are_refused(tmp_path, arm, joints):
    markers = markers_of(arm, joints)
    with pytest.raises(RecordingError, match="exported at 120"):
        marker_rows("t", written(tmp_path, markers, rate=120.0), "training", dataset())
    file = written(tmp_path, markers)
    file.write_bytes(b"".join(file.read_bytes().splitlines(keepends=True)[:-1]))
    with pytest.raises(RecordingError, match="spans 40 frames; the motion has 41"):
        marker_rows("t", file, "training", dataset())


def test_names_stand_without_their_asset_unless_two_assets_share_them(tmp_path, arm, joints):
    markers = {f"Arm:{name}": points for name, points in markers_of(arm, joints).items()}
    rows, _ = marker_rows("t", written(tmp_path, markers), "training", dataset())
    np.testing.assert_allclose(tracked(rows, arm).q, joints, rtol=0, atol=5e-5)
    file = written(tmp_path, markers | {"Leg:a1": markers["Arm:a1"] + 1})
    with pytest.raises(RecordingError, match="'a1' may be Arm:a1 or Leg:a1"):
        marker_rows("t", file, "training", dataset())
    named = {
        "link1": {
            "Arm:a1": TEMPLATE["link1"]["a1"],
            "b1": TEMPLATE["link1"]["b1"],
            "c1": TEMPLATE["link1"]["c1"],
        }
    }
    rows, quality = marker_rows("t", file, "training", dataset(markers=TEMPLATE | named))
    np.testing.assert_allclose(tracked(rows, arm).q, joints, rtol=0, atol=5e-5)
    assert quantity(quality, "unlabelled_markers") == 1


def test_a_c3d_take_gives_the_rows_of_the_csv_take(tmp_path, arm, joints):
    import ezc3d

    markers = markers_of(arm, joints)
    recording = ezc3d.c3d()
    recording["data"]["points"] = np.ones((4, 9, STEPS + 1))
    recording["data"]["points"][:3] = 1000 * np.stack(list(markers.values())).transpose(2, 0, 1)
    for key, value in {"RATE": [100.0], "LABELS": list(markers), "UNITS": ["mm"]}.items():
        recording["parameters"]["POINT"][key]["value"] = value
    recording.write(str(tmp_path / "t.c3d"))
    rows, _ = marker_rows("t", tmp_path / "t.c3d", "training", dataset())
    expected, _ = marker_rows("t", written(tmp_path, markers), "training", dataset())
    np.testing.assert_allclose(rows[["x", "y", "z"]], expected[["x", "y", "z"]], rtol=0, atol=1e-6)
    assert (
        rows[["take", "part", "k", "link", "marker"]]
        == expected[["take", "part", "k", "link", "marker"]]
    ).all(axis=None)


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
    with pytest.raises(RecordingError, match="two recordings are named 'train_1'"):
        find_takes(tmp_path, dataset(training="train_*").mocap)
    with pytest.raises(RecordingError, match="no test take matches"):
        find_takes(tmp_path, dataset(training="train_2*", test="none_*").mocap)
    with pytest.raises(ConfigError, match="must be a relative path"):
        find_takes(tmp_path, dataset(training="/takes/*").mocap)


def test_frames_that_repeat_the_one_before_are_missing_and_counted(tmp_path, arm, joints):
    markers = markers_of(arm, joints)
    for points in markers.values():
        points[11:14] = points[10]
    rows, quality = marker_rows("t", written(tmp_path, markers), "training", dataset())
    assert (quantity(quality, "frozen_frames"), quantity(quality, "missing_samples")) == (3, 27)
    assert rows[rows.x.isna()].k.unique().tolist() == [11, 12, 13]
    # the control: one marker that still moves
    markers["a1"][12] += 1e-5
    _, quality = marker_rows("t", written(tmp_path, markers), "training", dataset())
    assert quantity(quality, "frozen_frames") == 1


def test_a_file_whose_name_is_no_text_is_refused(tmp_path, arm, joints):
    written(tmp_path, markers_of(arm, joints)).rename(tmp_path / "t\udce9.csv")
    with pytest.raises(RecordingError, match="no UTF-8") as caught:
        find_takes(tmp_path, dataset().mocap)
    str(caught.value).encode()


GRID = 30
PLANAR = Robot(
    "pipeline/arm/ur5.urdf", ["joint_2", "joint_3", "joint_4"], "wrist_centre", plane=True
)


@pytest.fixture
def file(tmp_path):
    t = {"t": np.arange(GRID + 1) / 100}
    write_trajectory(
        tmp_path / "t.csv", pd.DataFrame(t | spread("q", UR5.joints, motion(GRID + 1)))
    )
    return tmp_path / "t.csv"


def commanded(robot=UR5, rate: float = 100.0) -> Dataset:
    return made(Dataset, robot=robot, motion=Motion(rate, GRID))


def test_the_steps_take_the_arm_from_each_commanded_pose_to_the_next(file):
    table, chain, q = trajectory_rows(file, commanded()), chain_of(UR5), motion(GRID + 1)
    steps = chain.displacement(chain.pose(q[:-1]), chain.pose(q[1:]))
    np.testing.assert_allclose(values(table, "v")[:-1] / 100, steps, atol=1e-12)
    assert members(table, "x") == chain.task and members(table, "u") == ()


def test_an_arm_of_more_joints_than_rows_is_told_its_joints_too(file):
    table = trajectory_rows(file, commanded(replace(UR5, task=["x", "y", "z"])))
    assert values(table, "v").shape == (GRID + 1, 3)
    np.testing.assert_allclose(
        values(table, "u")[:-1] / 100, np.diff(motion(GRID + 1), axis=0), atol=1e-12
    )


@pytest.mark.parametrize(
    ("robot", "rate", "words"),
    [(LWR4, 100.0, "the trajectory has the joints joint_1"), (UR5, 50.0, "asks for 31 at 50")],
)
def test_another_arms_or_another_grids_trajectory_is_refused(file, robot, rate, words):
    with pytest.raises(RecordingError, match=words):
        trajectory_rows(file, commanded(robot, rate))


def test_a_trajectory_of_the_plane_leaves_open_what_joints_do_beside_a_smaller_task(tmp_path):
    names = [*columns("x", PLANE), *columns("v", PLANE)]
    rows = pd.DataFrame(dict.fromkeys(names, 0.0), index=range(GRID + 1))
    write_trajectory(tmp_path / "t.csv", rows.assign(t=np.arange(GRID + 1) / 100))
    whole = trajectory_rows(tmp_path / "t.csv", commanded(PLANAR))
    assert len(whole) == GRID + 1
    with pytest.raises(RecordingError, match="export the commanded joints") as refused:
        trajectory_rows(tmp_path / "t.csv", commanded(replace(PLANAR, task=["x", "z"])))
    assert refused.value.evidence["key"] == "dataset.robot.task"


def test_of_pose_and_joints_the_pose_is_the_whole_tasks_and_the_joints_are_a_smaller_ones(tmp_path):
    names, q = PLANAR.joints, motion(GRID + 1)[:, 1:4]
    chain = chain_of(PLANAR)
    pose = trajectory_table(chain, q, 100.0)
    write_trajectory(tmp_path / "t.csv", pose)
    alone = trajectory_rows(tmp_path / "t.csv", commanded(PLANAR))
    write_trajectory(tmp_path / "t.csv", pose.assign(**spread("q", names, q)))
    beside = trajectory_rows(tmp_path / "t.csv", commanded(PLANAR))
    pd.testing.assert_frame_equal(beside, alone, check_exact=True)
    redundant = trajectory_rows(tmp_path / "t.csv", commanded(replace(PLANAR, task=["x", "z"])))
    assert members(redundant, "v") == ("x", "z")
    np.testing.assert_allclose(values(redundant, "x"), values(alone, "x")[:, :2], atol=1e-9)
    np.testing.assert_allclose(values(redundant, "v"), values(alone, "v")[:, :2], atol=1e-9)
    np.testing.assert_allclose(values(redundant, "u")[:-1] / 100, np.diff(q, axis=0), atol=1e-12)
