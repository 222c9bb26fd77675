"""How the camera's error depends on the pose, found from takes in which that is known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.columns import spread
from pipeline.studies.filters.camera import informed

JOINTS = ("a", "b")
SLOPE = np.array([[-0.2, 0.1], [-0.8, -0.5]])
TAKES, GRID = 30, 51


@pytest.fixture(scope="module")
def filmed() -> tuple[pd.DataFrame, pd.DataFrame, np.ndarray]:
    rng = np.random.default_rng(2)
    t, at = np.arange(GRID) / 100, np.arange(15) / 30
    path = np.stack([np.sin(t), np.cos(t)], axis=-1)
    bias = np.stack([0.1 * at, 0.2 - at], axis=-1)
    joints, angles = [], []
    for number in range(TAKES):
        off = np.cumsum(rng.standard_normal((GRID, 2)), axis=0) * 1e-2
        take, q = f"test_{number:02d}", path + off
        joints.append(pd.DataFrame({"take": take, "t": t} | spread("q", JOINTS, q)))
        point, moved = (
            np.stack([np.interp(at, t, column) for column in values.T], axis=-1)
            for values in (q, off)
        )
        y = point + bias + moved @ SLOPE.T + 1e-3 * rng.standard_normal(point.shape)
        frames = {"take": take, "frame": np.arange(15), "t": at}
        angles.append(pd.DataFrame(frames | spread("q", JOINTS, y)))
    return pd.concat(angles, ignore_index=True), pd.concat(joints, ignore_index=True), path


def test_the_slope_is_found_and_only_the_camera_s_own_noise_is_left(filmed):
    angles, joints, path = filmed
    takes, response = informed(angles, joints, path, 2)
    np.testing.assert_allclose(response, np.eye(2) + SLOPE, atol=0.01)
    std = np.sqrt(np.diagonal(np.stack([take.covariance for take in takes]), axis1=2, axis2=3))
    np.testing.assert_allclose(std.mean(axis=(0, 1)), 1e-3, rtol=0.1)
    assert len(takes) == TAKES and takes[3].y.shape == (15, 2)
