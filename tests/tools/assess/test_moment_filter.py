"""Innovations of takes of a known model are as large as predicted, and white; of another model they
are not.
"""

from __future__ import annotations

import numpy as np
import pytest
from exported_models import PARAMETERS, write_model

from pipeline.models import load
from pipeline.models.exported import ExportedModel
from pipeline.models.model import Commands
from pipeline.tools.assess.moment_filter import Innovations, filtered

TAKES, STEPS = 60, 40
POSE = np.diag([1.0, 2.0, 1.5]) * 1e-6


def takes(model: ExportedModel, v: np.ndarray, share: float) -> tuple[Commands, np.ndarray]:
    """Measured poses (TAKES, STEPS + 1, 3) in rad, and what commanded them."""
    rng, start = np.random.default_rng(1), np.array([0.3, 1.5, -0.4])
    path, q = [start], np.tile(start, (TAKES, 1))
    for each in v:
        path.append(path[-1] + model.chain.nominal_step(path[-1], each))
    targets, true = model.chain.pose(np.array(path)), [q]
    for each, target in zip(v, targets, strict=False):
        q = model.step(q, model.command(q, each, target), rng)
        true.append(q)
    noise = rng.multivariate_normal(np.zeros(3), POSE, (TAKES, STEPS + 1))
    return Commands(v, targets[:-1], share), np.stack(true, axis=1) + noise


def loaded(folder, kind: str, chain, share: float = 0.0, pose: np.ndarray | None = POSE):
    model = load(write_model(folder / "model.json", kind, chain, share=share))
    model.record["pose_covariance_rad2"] = None if pose is None else pose.tolist()
    return model


def mean_nees(result: Innovations) -> float:
    white = np.linalg.solve(result.covariance, result.error[..., None])[..., 0]
    return float(np.vecdot(result.error, white).mean())


@pytest.mark.parametrize("share", [0.0, 0.2])
@pytest.mark.parametrize("kind", PARAMETERS)
def test_innovations_are_as_large_as_predicted_and_white(kind, share, chain, tmp_path):
    model = loaded(tmp_path, kind, chain, share)
    v = np.sin(np.linspace(0, 3, STEPS))[:, None] * np.array([0.0005, -0.0005, 0.01])
    commands, poses = takes(model, v, share)
    result = filtered(model, commands, poses)
    # 3 on average; 2400 steps of heavy tails vary by a few per cent
    assert mean_nees(result) == pytest.approx(3.0, rel=0.08)
    z = result.error / result.std
    assert abs(np.mean(z[:, 1:] * z[:, :-1])) < 0.06
    # the control: to a filter that holds the measured poses for exact they are correlated
    exact = loaded(tmp_path, kind, chain, share, pose=np.eye(3) * 1e-12)
    result = filtered(exact, commands, poses)
    z = result.error / result.std
    assert mean_nees(result) > 3.5 or np.mean(z[:, 1:] * z[:, :-1]) < -0.06
