"""A take of an arm in space with what two made-up models say of its joints."""

from __future__ import annotations

import numpy as np

from pipeline.core.options.dataset import Robot
from pipeline.tools.page.posterior import Posterior
from pipeline.tools.page.scene import scene_of
from pipeline.tools.page.take import Take

UR5 = Robot("pipeline/arm/ur5.urdf", [f"joint_{j}" for j in range(1, 7)], "flange")
STEPS, FRAMES = 41, 9
BIAS = {"additive": 0.0, "gaussian": 2e-4}  # rad


def spatial_take(robot: Robot = UR5, size: float = 1e-4, filtered: bool = False) -> Take:
    """A motion of ``robot`` whose joints have errors of about ``size`` in rad."""
    n = len(robot.joints)
    t, number = np.arange(STEPS) / 100, np.arange(1, n + 1)
    truth = 0.4 + 0.5 * np.sin(2 * t[:, None] + number)
    root = np.random.default_rng(3).standard_normal((n, n)) * size
    covariance = np.broadcast_to(root @ root.T, (STEPS, n, n))
    posteriors = {
        model: Posterior(
            truth + bias, (1 + place) ** 2 * covariance, np.full(STEPS, 99.0) if filtered else None
        )
        for place, (model, bias) in enumerate(BIAS.items())
    }
    rows = np.linspace(0, STEPS - 1, FRAMES).astype(int)
    scene = scene_of(robot, truth, posteriors, rows)
    return Take("train_1", tuple(robot.joints), t, truth, posteriors, t[rows], None, scene)
