"""Worked examples with exported plain models of a UR5 and an LWR4+: a filter of filterpy, a
planner's cost and the covariance of a frame by pinocchio's Jacobian.
"""

from __future__ import annotations

import json
import sys
import types
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from source_code import ROOT

from pipeline.core.options.dataset import Robot
from pipeline.models.joint_steps_fit import fit_joint_steps
from pipeline.tools.export.command import write_export
from pipeline.tools.export.reader_file import NAME
from pipeline.tools.export.record import bare_record

ARMS = {"ur5": (6, np.zeros(6)), "lwr4": (7, np.full(7, 0.3))}
RATE = 125.0


@pytest.fixture(params=ARMS)
def arm(request, tmp_path, monkeypatch) -> SimpleNamespace:
    """A colleague's folder with an exported model, and the reader of that folder."""
    name, (n, home) = request.param, ARMS[request.param]
    joints = [f"joint_{number}" for number in range(1, n + 1)]
    urdf = ROOT / f"pipeline/arm/{name}.urdf"
    dataset = SimpleNamespace(
        name=name,
        robot=Robot(urdf=str(urdf), joints=joints, tool="flange"),
        motion=SimpleNamespace(rate=RATE, pose_noise=None),
    )
    rng = np.random.default_rng(1)
    dq = 6e-3 * np.sin(np.outer(np.arange(4000), 0.01 + 0.003 * np.arange(n)))
    noise = (2e-5 + 0.02 * np.abs(dq)) * rng.standard_normal(dq.shape)
    fit = fit_joint_steps("scaled_all", dq, noise, joints)
    record = bare_record("scaled_all", SimpleNamespace(dataset=dataset)) | {
        "parameters": fit.model.parameters(),
        "not_known": [],
        "ranges": {},
    }
    file = tmp_path / f"{name}_scaled_all.json"
    write_export(record, file)
    monkeypatch.syspath_prepend(tmp_path)

    module = types.ModuleType("read_motion_model")
    monkeypatch.setitem(sys.modules, "read_motion_model", module)
    exec(compile((tmp_path / NAME).read_text(), NAME, "exec"), module.__dict__)
    return SimpleNamespace(model=module.load(file), urdf=urdf, home=home, dq=dq[:200], n=n)


def test_a_kalman_filter_of_filterpy_follows_the_joints(arm):
    kalman = pytest.importorskip(
        "filterpy.kalman", reason="filterpy is missing; `make` installs requirements.lock"
    )
    rng, n = np.random.default_rng(2), arm.n
    filtered = kalman.KalmanFilter(dim_x=n, dim_z=n, dim_u=n)
    filtered.F = filtered.H = filtered.B = np.eye(n)
    filtered.x, filtered.P = arm.home.copy(), 1e-8 * np.eye(n)
    filtered.R = (5e-4) ** 2 * np.eye(n)
    true, errors, measured = arm.home.copy(), [], []
    for dq in arm.dq:
        Q = arm.model.covariance_of_joint_step(dq)
        true = true + dq + rng.multivariate_normal(np.zeros(n), Q)
        y = true + 5e-4 * rng.standard_normal(n)
        filtered.predict(u=dq, Q=Q)
        filtered.update(y)
        errors.append(filtered.x - true)
        measured.append(y - true)
    assert np.sqrt(np.mean(np.square(errors))) < 0.7 * np.sqrt(np.mean(np.square(measured)))


def test_a_planner_finds_slow_steps_less_uncertain(arm):
    def cost(count: int) -> float:
        """Sum of the variances of a motion of 0.2 rad of every joint in ``count`` equal steps."""
        dq = np.full((count, arm.n), 0.2 / count)
        return float(np.trace(arm.model.covariance_of_joint_step(dq), axis1=1, axis2=2).sum())

    costs = {count: cost(count) for count in (40, 80, 160, 640, 2560)}
    best = min(costs, key=costs.get)
    assert costs[40] > costs[80] > costs[160] and best not in (40, 2560)


def test_the_covariance_of_a_frame_is_that_of_drawn_poses(arm):
    pinocchio = pytest.importorskip("pinocchio", reason="pinocchio is missing")
    model = pinocchio.buildModelFromUrdf(str(arm.urdf))
    data, frame = model.createData(), model.getFrameId("flange")
    dq = arm.dq[60]
    sigma = arm.model.covariance_of_joint_step(dq)
    q = arm.home + dq
    pinocchio.computeJointJacobians(model, data, q)
    pinocchio.updateFramePlacements(model, data)
    J = pinocchio.getFrameJacobian(
        model, data, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )[:3]
    drawn = np.random.default_rng(3).multivariate_normal(q, sigma, 20_000)
    points = arm.model.chain.pose(drawn)[..., :3]
    expected = J @ sigma @ J.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.cov(points.T) / scale, expected / scale, atol=0.06)


def test_the_reader_is_beside_the_model(arm, tmp_path):
    record = json.loads(next(Path(tmp_path).glob("*.json")).read_text())
    assert (tmp_path / NAME).is_file() and record["model"] == "scaled_all"
    assert repr(arm.model).startswith("<motion model scaled_all of")
