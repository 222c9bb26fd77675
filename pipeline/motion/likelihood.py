"""Maximum likelihood: σ_B of the Wishart model and (α, u) of the Gaussian matrix model from measured steps.

Both maximise Σ ln p(q̃_{k+1} | q̃_k) over the recorded steps, where p is the exact density of a step plus the measurement noise
N(0, Σ_m). Without Σ_m the steps at rest would have no density, and the slowest of the others would decide everything.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ModelDomainError
from pipeline.motion.decomposition import Decomposition
from pipeline.motion.density import normal_log_density
from pipeline.motion.gaussian import frobenius, noise_scale
from pipeline.motion.gaussian_fit import GaussianFit, search
from pipeline.motion.wishart import WishartModel
from pipeline.randommatrix.wishart import largest_dispersion

LEAST_SIGMA_B = 0.01  # d = 40 000: a step that differs from the nominal one by 1 %
ALPHA_RANGE = 30.0  # α is sought within this factor of what the second moments suggest
TOLERANCE = 1e-4  # of ln σ_B and ln α


@dataclass(frozen=True)
class DispersionFit:
    """σ̂_B of greatest likelihood."""

    sigma_b: float
    at_end: bool  # whether the search stopped at an end of the interval where B has a density


def moving_steps(q: np.ndarray, v: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, 3) each: poses, commanded steps and ω of the steps with a command, the only ones that say anything of a matrix model.

    ``q`` and ``noise`` (takes, M, 3) in rad, ``v`` (M, 3). Raises ModelDomainError for a motion at rest throughout.
    """
    moving = np.any(v, axis=-1)
    if not np.any(moving):
        raise ModelDomainError("the motion is at rest at every step: there is nothing to fit a matrix model to")
    commanded = np.broadcast_to(v, q.shape)
    return q[:, moving].reshape(-1, 3), commanded[:, moving].reshape(-1, 3), noise[:, moving].reshape(-1, 3)


def fit_sigma_b(
    chain: PlanarChain, q: np.ndarray, v: np.ndarray, noise: np.ndarray, measurement: np.ndarray, decomposition: Decomposition
) -> DispersionFit:
    """σ̂_B by a search over ln σ_B between LEAST_SIGMA_B and the widest σ_B that has a density.

    ``q`` (takes, M, 3) measured poses in rad before each step, ``v`` (M, 3) commanded steps (m, m, rad), ``noise`` ω (takes, M, 3) in rad,
    ``measurement`` Σ_m (3, 3) in rad². Raises SingularJacobianError and ModelDomainError.
    """
    q, v, noise = moving_steps(q, v, noise)
    q_next = q + np.matvec(chain.inverse_jacobian(q), v) + noise

    def cost(log_sigma_b: float) -> float:
        return -float(WishartModel(np.exp(log_sigma_b), decomposition).log_density(chain, q, v, q_next, measurement).mean())

    low, high = np.log(LEAST_SIGMA_B), np.log(largest_dispersion(3))
    best = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": TOLERANCE})
    return DispersionFit(float(np.exp(best.x)), bool(min(best.x - low, high - best.x) < 10 * TOLERANCE))


def fit_alpha_u(
    chain: PlanarChain, q: np.ndarray, v: np.ndarray, noise: np.ndarray, measurement: np.ndarray, extensions: np.ndarray
) -> GaussianFit:
    """(α̂, û) and the ridge: the greatest likelihood over α for each u = max ‖J⁻¹‖_F·(1 + extension), and the best of these, refined.

    The maximum is over all recorded poses with a command, so that no recorded step is beyond the bound; ``extensions`` (G ≥ 3, ascending,
    positive) are shares of it. The other arguments as in :func:`fit_sigma_b`. ``objective`` of the fit is −Σ ln p over the steps with a
    command. Raises SingularJacobianError and ModelDomainError.
    """
    q, v, noise = moving_steps(q, v, noise)
    norms, speeds = frobenius(chain.inverse_jacobian(q)), np.vecdot(v, v)
    largest = float(norms.max())
    squared = float(np.mean(noise**2))

    def best(extension: float) -> tuple[float, float]:
        gain = noise_scale(norms, 1.0, largest * (1 + extension), 3) * speeds

        def cost(log_alpha: float) -> float:
            return -float(normal_log_density(noise, np.exp(2 * log_alpha) * gain, measurement).sum())

        middle = 0.5 * np.log(squared / gain.mean())
        bounds = (middle - np.log(ALPHA_RANGE), middle + np.log(ALPHA_RANGE))
        found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": TOLERANCE})
        return float(found.fun), float(np.exp(found.x))

    found = search(best, extensions)
    return GaussianFit(
        found.alpha, largest * (1 + found.extension), largest * found.extension, found.objective, found.at_end,
        largest * extensions, found.objectives, found.alphas,
    )  # fmt: skip
