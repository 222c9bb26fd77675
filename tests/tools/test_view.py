"""A take in Rerun: the skeleton is where the arm's kinematics put it, and the file holds every
track.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from source_code import ROOT

from pipeline.arm.model import arm_of
from pipeline.core.errors import PipelineError
from pipeline.core.options.dataset import Robot
from pipeline.tools.view import command
from pipeline.tools.view.command import Track, ViewedTake, skeletons, write_recording

JOINTS = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
YOUBOT = Robot(
    urdf=str(ROOT / "pipeline/arm/youbot.urdf"),
    joints=JOINTS,
    tool="arm_tool",
    plane=True,
    locked={"arm_joint_1": 2.9, "arm_joint_5": 2.9},
)


@pytest.fixture
def poses() -> np.ndarray:
    return np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))


def test_the_skeleton_of_a_planar_arm_is_that_of_its_closed_form(poses):
    arm = arm_of(YOUBOT)
    nodes = skeletons(YOUBOT, poses)
    np.testing.assert_array_equal(nodes[:, 0], 0.0)
    plane = arm.to_plane(nodes[:, 1:])
    np.testing.assert_allclose(plane[..., 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(plane[..., [0, 2]], arm.chain.points(poses), atol=1e-12)


def test_without_the_viewer_the_command_names_what_installs_it(monkeypatch, tmp_path):
    monkeypatch.setattr(command, "ENVIRONMENT", tmp_path)
    monkeypatch.setitem(command.sys.modules, "rerun", None)
    with pytest.raises(PipelineError, match="run `make view`"):
        command._rerun()


@pytest.mark.slow
def test_the_file_holds_arm_cloud_and_angles_with_their_bounds(monkeypatch, poses, tmp_path):
    monkeypatch.setattr(command, "ENVIRONMENT", ROOT / ".venv-view")
    monkeypatch.setattr(command.sys, "path", [*command.sys.path])
    try:
        rerun = command._rerun()
    except PipelineError:
        pytest.skip("rerun-sdk is absent; `make test-all` installs it in .venv-view")
    t = 0.1 * np.arange(20)
    filtered = {"wishart": Track(t, poses + 0.1, np.full_like(poses, 0.2))}
    clouds = [(0.5, np.ones((7, 3)))]
    take = ViewedTake("test 1", YOUBOT, JOINTS, Track(t, poses), filtered, clouds)
    file = tmp_path / "take.rrd"
    write_recording(rerun, take, file)
    from rerun.chunk import RrdReader

    chunks = RrdReader(file).stream().to_chunks()
    rows = Counter()
    for chunk in chunks:
        rows[chunk.entity_path] += 0 if chunk.is_static else chunk.num_rows
    lines = ["measured/mean", *(f"wishart/{line}" for line in ("mean", "upper", "lower"))]
    expected = {f"/angles/{joint}/{line}": 20 for joint in JOINTS for line in lines}
    expected |= {"/scene/measured": 20, "/scene/wishart": 20, "/scene/cloud": 1}
    assert {path: rows[path] for path in expected} == expected
