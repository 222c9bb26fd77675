"""A take in Rerun has its skeleton where the kinematics put it, and the file has every track."""

from collections import Counter

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from source_code import ROOT
from space_arms import YOUBOT

from pipeline.arm.model import arm_of
from pipeline.core.errors import PipelineError
from pipeline.tools.view import command
from pipeline.tools.view.command import Track, skeletons, write_recording

POSES = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))


def test_the_skeleton_of_a_planar_arm_is_its_closed_form():
    arm = arm_of(YOUBOT)
    nodes = skeletons(YOUBOT, POSES)
    assert_array_equal(nodes[:, 0], 0.0)

    plane = arm.to_plane(nodes[:, 1:])
    assert_allclose(plane[..., 1], 0.0, atol=1e-12)
    assert_allclose(plane[..., [0, 2]], arm.chain.points(POSES), atol=1e-12)


@pytest.mark.slow
def test_the_file_holds_arm_cloud_and_angles_with_their_bounds(monkeypatch, tmp_path):
    monkeypatch.setattr(command, "ENVIRONMENT", ROOT / ".venv-view")
    monkeypatch.setattr(command.sys, "path", [*command.sys.path])
    try:
        rerun = command._rerun()
    except PipelineError:
        pytest.skip("rerun-sdk is absent; `make test-all` installs it in .venv-view")
    t = 0.1 * np.arange(20)
    file = tmp_path / "take.rrd"
    tracks = {"measured": Track(t, POSES)}
    tracks["wishart"] = Track(t, POSES + 0.1, np.full_like(POSES, 0.2))
    write_recording(rerun, file, "test 1", YOUBOT, tracks, [(0.5, np.ones((7, 3)))])
    from rerun.chunk import RrdReader

    rows = Counter()
    for chunk in RrdReader(file).stream().to_chunks():
        rows[chunk.entity_path] += 0 if chunk.is_static else chunk.num_rows
    lines = [
        "measured/mean",
        *(f"wishart/{line}" for line in ("mean", "upper", "lower")),
    ]
    expected = {
        f"/angles/{joint}/{line}": 20 for joint in YOUBOT.joints for line in lines
    }
    expected |= {"/scene/measured": 20, "/scene/wishart": 20, "/scene/cloud": 1}
    assert {path: rows[path] for path in expected} == expected
