"""An arm in space is where its URDF and Pinocchio have it, and the ellipsoid of its tip is that of
poses drawn from what a model says of its joints.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from spatial_take import BIAS, FRAMES, UR5, spatial_take

from pipeline.arm.model import chain_of
from pipeline.core.options.dataset import Robot
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.steps import Recorded
from pipeline.tools.page.player import player
from pipeline.tools.page.posterior import one_step_ahead
from pipeline.tools.page.scene import SHOWN
from pipeline.tools.page.take import evenly

LWR4 = Robot("pipeline/arm/lwr4.urdf", [f"joint_{j}" for j in range(1, 8)], "flange")


@pytest.mark.parametrize("robot", [UR5, LWR4], ids=["ur5", "lwr4"])
def test_the_skeleton_is_that_of_pinocchio_from_the_base_to_the_tip(robot):
    take = spatial_take(robot)
    model = pin.buildModelFromUrdf(robot.urdf)
    data = model.createData()
    q = take.truth[np.searchsorted(take.t, take.frame_t)]
    for pose, nodes in zip(q, take.view.nodes, strict=True):
        pin.framesForwardKinematics(model, data, pose)
        joints = [data.oMi[i].translation for i in range(1, model.njoints)]
        tip = data.oMf[model.getFrameId(robot.tool)].translation
        np.testing.assert_allclose(nodes, [np.zeros(3), *joints, tip], atol=1e-12)
    np.testing.assert_allclose(take.view.path[0], take.view.nodes[0, -1])


def test_the_ellipsoid_of_the_tip_is_that_of_drawn_poses():
    take, frame = spatial_take(size=1e-4), 4
    step = int(np.searchsorted(take.t, take.frame_t[frame]))
    chain, posterior = chain_of(UR5), take.posteriors["gaussian"]
    rng = np.random.default_rng(1)
    q = rng.multivariate_normal(posterior.mean[step], posterior.covariance[step], 20_000)
    tips = chain.pose(q)[:, :3]
    drawn, view = np.cov(tips.T), take.view
    # over 20000 draws a variance has a relative standard error of 1 %
    expected = view.covariances["gaussian"][frame]
    np.testing.assert_allclose(drawn, expected, atol=0.05 * np.trace(expected))
    mean = tips.mean(axis=0) - view.nodes[frame, -1]
    np.testing.assert_allclose(
        mean, view.deviations["gaussian"][frame], atol=5 * np.sqrt(np.trace(drawn) / 20_000)
    )
    # the control: those of the other model are others
    assert np.trace(view.covariances["additive"][frame]) < 0.3 * np.trace(drawn)


@pytest.mark.parametrize("size", [1e-6, 1e-4, 1e-3, 0.0])
def test_what_is_small_is_drawn_larger_by_a_round_number(size):
    view = spatial_take(size=size).view
    digits = str(view.magnification).rstrip("0")
    assert digits in ("1", "2", "5")
    greatest = max(np.linalg.eigvalsh(each)[:, -1].max() for each in view.covariances.values())
    drawn = view.magnification * np.sqrt(max(greatest, 0.0)) / view.radius
    assert drawn <= SHOWN and (drawn > SHOWN / 2.6 or size == 0)


def test_the_player_of_an_arm_in_space_has_its_own_joints_and_no_camera():
    played = player(spatial_take())
    assert played.joints == [f"joint {j}" for j in range(1, 7)]
    assert played.size is None and not played.filtered and len(played.frames) == FRAMES
    for frame in played.frames:
        assert "dots" not in frame and "image" not in frame
        assert len(frame["nodes"]) == 8 and set(frame["tips"]) == set(BIAS)
        assert [len(shown["texts"]) for shown in frame["models"].values()] == [6, 6]
    plain = {"scene": played.scene, "frames": played.frames}
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    filtered = player(spatial_take(filtered=True))
    assert filtered.filtered and filtered.frames[0]["models"]["additive"]["texts"][-1] == "99"


def test_what_is_drawn_of_the_tip_is_magnified_about_the_measured_one():
    take = spatial_take()
    played, view = player(take), take.view
    tip = played.frames[3]["tips"]["gaussian"]
    times = played.scene["times"]
    place = view.nodes[3, -1] + times * view.deviations["gaussian"][3]
    np.testing.assert_allclose(tip["place"], place, atol=1e-4)
    drawn = times**2 * view.covariances["gaussian"][3][np.triu_indices(3)]
    np.testing.assert_allclose(tip["covariance"], drawn, rtol=1e-3)


def test_one_step_ahead_is_the_law_of_the_step_and_of_the_first_pose_nothing_is_open():
    robot = replace(UR5, task=["x", "y", "z"])
    chain = chain_of(robot)
    q = spatial_take().truth[None, :-1]
    v = np.tile([1e-3, 0.0, 2e-3], (q.shape[1], 1))
    model = AdditiveModel(np.diag(np.arange(1.0, 7.0)) * 1e-8)
    recorded = Recorded(chain, q, v, np.zeros_like(q), tuple(robot.joints))
    said = one_step_ahead(model, recorded)
    np.testing.assert_allclose(said.mean[0], q[0, 0])
    np.testing.assert_allclose(said.mean[1:], q[0] + np.linalg.pinv(chain.jacobian(q[0])) @ v[0])
    assert not said.covariance[0].any() and said.ess is None
    np.testing.assert_allclose(said.covariance[7], np.diag(np.arange(1.0, 7.0)) * 1e-8)


@pytest.mark.parametrize(("count", "most"), [(5, 33), (33, 33), (1101, 321), (2, 2)])
def test_frames_are_spread_over_the_whole_take(count, most):
    rows = evenly(count, most)
    assert rows[0] == 0 and rows[-1] == count - 1 and len(rows) == min(count, most)
    assert np.ptp(np.diff(rows)) <= 1
