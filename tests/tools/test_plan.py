"""A plan is a trajectory that the project reads; what cannot be planned leaves nothing behind. A
take in Rerun has its skeleton where the arm's kinematics put it, and the file holds every track.
"""

import json
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from planning_arms import ARMS, LAWS, PLANAR, chain, joint_path
from scipy.spatial.transform import Rotation
from source_code import ROOT

from pipeline.__main__ import tool_call
from pipeline.arm.model import arm_of
from pipeline.configuration import config
from pipeline.core.errors import PipelineError
from pipeline.formats.trajectory import read_trajectory
from pipeline.tools.plan.command import read_path
from pipeline.tools.view import command
from pipeline.tools.view.command import Track, skeletons, write_recording

STEPS = 20


def run(words: list[str]) -> None:
    tool_call("plan", words)()


@pytest.fixture
def work(tmp_path, monkeypatch):
    """A folder with a planar arm that has a joint to spare, a fit and a path."""
    monkeypatch.chdir(tmp_path)
    settings = SimpleNamespace(dataset=SimpleNamespace(robot=ARMS["planar"][0]))
    monkeypatch.setattr(config, "sections", lambda stage: settings)
    fit = tmp_path / "data/fit/wishart"
    fit.mkdir(parents=True)
    (fit / "parameters.json").write_text(json.dumps(LAWS["qr_transposed"]))
    write_path(tmp_path / "path.csv")
    return tmp_path


def write_path(file, **changes: object) -> None:
    pose = chain("planar").pose(joint_path("planar", STEPS))
    t = np.arange(STEPS + 1) / 10
    table = pd.DataFrame(
        {"note": 0, "z": pose[:, 2], "t": t, "x": pose[:, 0]} | changes
    )
    table.to_csv(file, index=False, lineterminator="\n")


@pytest.mark.slow
def test_a_plan_follows_the_path_within_the_limits_and_can_be_read_and_seen(
    work, capsys
):
    run(["wishart", "path.csv", "out", "--margin", "0.03", "--points", "30"])
    table = read_trajectory(work / "out/joints.csv")
    assert list(table) == ["t", "q:arm_joint_2", "q:arm_joint_3", "q:arm_joint_4"]
    arm, q = chain("planar"), table.to_numpy()[:, 1:]
    off = arm.displacement(arm.pose(q), arm.pose(joint_path("planar", STEPS)))
    assert np.abs(off).max() < 1e-8
    assert arm.within_limits(q).all()
    assert np.all(np.abs(np.diff(q, axis=0)) <= arm.max_speed / 10 * 1.001)
    assert Image.open(work / "out/plan.png").size[0] > 1000
    said = capsys.readouterr().out
    assert (
        "plan: 20 steps; sum of tr Cov (rad²) " in said
        and "wrote out/joints.csv" in said
    )
    # a plan may take the place of a plan, and its own joints are a path
    run(["data/fit/wishart", "out/joints.csv", "out", "--points", "30"])


def test_what_cannot_be_planned_is_one_message_and_nothing_is_written(work):
    jump = {"t": np.r_[np.arange(20), 50] / 10}
    for changes, words, message in (
        ({"x": 9.0}, [], r"does not reach the pose .*\[step 0\]"),
        ({"t": np.arange(21) / 2000}, [], r"speed limits; .*\[step "),
        ({}, ["--margin", "0.5"], r"below the margin of 0.5 m \[step 0\]"),
        (jump, [], r"steps must be equal .*path.csv, line 22"),
        ({"x": "a"}, [], r"holds 'a', not a finite number \[.*path.csv, line 2"),
        ({}, ["--points", "0"], "must be > 0, got 0"),
    ):
        write_path(work / "path.csv", **changes)
        with pytest.raises(PipelineError, match=message):
            run(["wishart", "path.csv", "out", "--points", "30", *words])
    for words, message in (
        (["other", "path.csv", "out"], "no fitted parameters"),
        (["wishart", "none.csv", "out"], "cannot be read .*none.csv"),
        (["wishart", "path.csv", "data"], "exists and contains no plan"),
    ):
        with pytest.raises(PipelineError, match=message):
            run(words)
    (work / "path.csv").write_text("t,x\n0,1\n1,2\n")
    with pytest.raises(PipelineError, match="must name z once each, of t, x, z"):
        run(["wishart", "path.csv", "out"])
    assert sorted(file.name for file in work.iterdir()) == ["data", "path.csv"]


def test_a_pose_in_space_is_a_position_and_a_rotation_vector(tmp_path):
    arm, robot, file = chain("seven"), ARMS["seven"][0], tmp_path / "path.csv"
    pose = arm.pose(joint_path("seven", 5))
    turn = Rotation.from_matrix(pose[:, 3:].reshape(-1, 3, 3)).as_rotvec()
    rows = np.column_stack([np.arange(6) / 4, pose[:, :3], turn])
    table = pd.DataFrame(rows, columns=["t", *arm.task])
    table.to_csv(file, index=False, lineterminator="\n")
    path, rate = read_path(file, arm, robot)
    np.testing.assert_allclose(path, pose, atol=1e-12)
    assert rate == pytest.approx(4.0)


def test_joints_in_any_order_stand_for_their_poses_and_others_are_refused(tmp_path):
    arm, robot, file = chain("planar"), ARMS["planar"][0], tmp_path / "joints.csv"
    q = joint_path("planar", 5)
    table = {f"q:{name}": q[:, j] for j, name in reversed([*enumerate(robot.joints)])}
    pd.DataFrame({"t": np.arange(6.0)} | table).to_csv(
        file, index=False, lineterminator="\n"
    )
    np.testing.assert_allclose(read_path(file, arm, robot)[0], arm.pose(q), atol=1e-12)
    file.write_text(file.read_text().replace("arm_joint_2", "wrist"))
    with pytest.raises(PipelineError, match="but the arm has arm_joint_2, arm_joint_3"):
        read_path(file, arm, robot)


POSES = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))


def test_the_skeleton_of_a_planar_arm_is_its_closed_form():
    arm, nodes = arm_of(PLANAR), skeletons(PLANAR, POSES)
    np.testing.assert_array_equal(nodes[:, 0], 0.0)
    plane = arm.to_plane(nodes[:, 1:])
    np.testing.assert_allclose(plane[..., 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(plane[..., [0, 2]], arm.chain.points(POSES), atol=1e-12)


@pytest.mark.slow
def test_the_file_holds_arm_cloud_and_angles_with_their_bounds(monkeypatch, tmp_path):
    monkeypatch.setattr(command, "ENVIRONMENT", ROOT / ".venv-view")
    monkeypatch.setattr(command.sys, "path", [*command.sys.path])
    try:
        rerun = command._rerun()
    except PipelineError:
        pytest.skip("rerun-sdk is absent; `make test-all` installs it in .venv-view")
    t, file = 0.1 * np.arange(20), tmp_path / "take.rrd"
    tracks = {"measured": Track(t, POSES)}
    tracks["wishart"] = Track(t, POSES + 0.1, np.full_like(POSES, 0.2))
    write_recording(rerun, file, "test 1", PLANAR, tracks, [(0.5, np.ones((7, 3)))])
    from rerun.chunk import RrdReader

    rows = Counter()
    for chunk in RrdReader(file).stream().to_chunks():
        rows[chunk.entity_path] += 0 if chunk.is_static else chunk.num_rows
    lines = [
        "measured/mean",
        *(f"wishart/{line}" for line in ("mean", "upper", "lower")),
    ]
    expected = {
        f"/angles/{joint}/{line}": 20 for joint in PLANAR.joints for line in lines
    }
    expected |= {"/scene/measured": 20, "/scene/wishart": 20, "/scene/cloud": 1}
    assert {path: rows[path] for path in expected} == expected
