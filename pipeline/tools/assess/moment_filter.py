"""The filter of measured poses by the first two moments of a motion model.

Between two measured poses the law of a step is taken for the normal one of its mean and covariance,
the mean's slope F by differences (the extended Kalman filter; Anderson & Moore, Optimal Filtering,
1979, Sec. 8.2):

    x⁻ = E(q_{k+1} | x),   P⁻ = F P Fᵀ + Cov(q_{k+1} | x),   S = P⁻ + Σ,   G = P⁻S⁻¹,
    x = x⁻ + G(y − x⁻),   P = (I − G)P⁻.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.exported import ExportedModel
from pipeline.models.model import Commands

DIFFERENCE = 1e-5  # rad


class Innovations(NamedTuple):
    """What each measured pose of T takes added to those before it."""

    error: np.ndarray  # (T, M, n) rad, measured minus predicted
    covariance: np.ndarray  # (T, M, n, n) rad², S that was predicted of it

    @property
    def std(self) -> np.ndarray:
        """(T, M, n) rad, by joint."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))


def filtered(model: ExportedModel, commands: Commands, poses: np.ndarray) -> Innovations:
    """The innovations of the measured ``poses`` (T, M+1, n) in rad under the ``commands``.

    The noise Σ of a measured pose is the one that the model was exported with; none where it is not
    known. Raises ModelDomainError where the model has no moments, or is sure of a pose.
    """
    known, n = model.record["pose_covariance_rad2"], poses.shape[-1]
    noise = np.zeros((n, n)) if known is None else np.array(known)
    x, spread = poses[:, 0], np.broadcast_to(noise, (len(poses), n, n))
    error = np.empty_like(poses[:, 1:])
    covariance = np.empty((*error.shape, n))
    shifts = DIFFERENCE * np.concatenate([np.eye(n), -np.eye(n)])[:, None]
    for k, v in enumerate(commands.v):

        def mean(q: np.ndarray, v: np.ndarray = v, k: int = k) -> np.ndarray:
            return model.mean(q, model.command(q, v, commands.path[k]))

        beyond = mean(x + shifts)
        slope = np.moveaxis(beyond[:n] - beyond[n:], 0, -1) / (2 * DIFFERENCE)
        step = model.covariance(x, model.command(x, v, commands.path[k]))
        spread = slope @ spread @ np.swapaxes(slope, -1, -2) + step
        predicted, total = mean(x), spread + noise
        error[:, k], covariance[:, k] = poses[:, k + 1] - predicted, total
        try:
            gain = np.swapaxes(np.linalg.solve(total, spread), -1, -2)
        except np.linalg.LinAlgError:
            raise ModelDomainError(
                "the model is sure of a pose, which no measurement can be held against; state "
                "dataset.motion.pose_noise and export it again",
                step=k,
            ) from None
        x = predicted + np.matvec(gain, error[:, k])
        spread = spread - gain @ spread
        spread = (spread + np.swapaxes(spread, -1, -2)) / 2
    return Innovations(error, covariance)
