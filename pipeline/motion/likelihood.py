"""Maximum likelihood: σ_B of the Wishart model and (α, u) of the Gaussian matrix model from measured steps.

Both maximise Σ ln p(q̃_{k+1} | q̃_k) over the recorded steps, where p is the exact density of a step plus the measurement noise
N(0, Σ_m). Without Σ_m the steps at rest would have no density, and the slowest of the others would decide everything.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
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
TOLERANCE = 1e-4  # of ln α
COARSE = 0.05  # of ln σ_B: how near the greatest likelihood is sought before it is read off a spline
REACH, NODES = 0.4, 9  # of that spline over ln σ_B, on either side, and its nodes: they leave an error below 1e-4


@dataclass(frozen=True)
class DispersionFit:
    """σ̂_B of greatest likelihood, and the likelihood of each take about it."""

    sigma_b: float
    at_end: bool  # whether it is at an end of the interval where B has a density
    log_sigma_b: np.ndarray  # (NODES,) ascending
    log_likelihoods: np.ndarray  # (takes, NODES) Σ ln p over the steps of each take

    def of(self, takes: np.ndarray) -> float:
        """σ̂_B of the takes with these numbers, as often as each is named; raises ModelDomainError where it is beyond the nodes."""
        best = _greatest(self.log_sigma_b, self.log_likelihoods[takes].sum(axis=0))
        if not self.at_end and best in (self.log_sigma_b[0], self.log_sigma_b[-1]):
            raise ModelDomainError("the likelihood of these takes is greatest beyond where it was evaluated", takes=takes.tolist())
        return float(np.exp(best))


def _greatest(x: np.ndarray, values: np.ndarray) -> float:
    """Where the spline through ``values`` (N,) at ``x`` (N,) is greatest."""
    spline = CubicSpline(x, values)
    candidates = np.concatenate([x[[0, -1]], spline.derivative().roots(extrapolate=False)])
    return float(candidates[spline(candidates).argmax()])


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
    takes = len(q)
    q, v, noise = moving_steps(q, v, noise)
    q_next = q + np.matvec(chain.inverse_jacobian(q), v) + noise

    def of_takes(log_sigma_b: float) -> np.ndarray:
        density = WishartModel(np.exp(log_sigma_b), decomposition).log_density(chain, q, v, q_next, measurement)
        return density.reshape(takes, -1).sum(axis=1)

    low, high = np.log(LEAST_SIGMA_B), np.log(largest_dispersion(3)) - TOLERANCE
    coarse = minimize_scalar(lambda x: -of_takes(x).sum(), bounds=(low, high), method="bounded", options={"xatol": COARSE})
    nodes = np.linspace(max(low, coarse.x - REACH), min(high, coarse.x + REACH), NODES)
    log_likelihoods = np.stack([of_takes(x) for x in nodes], axis=1)
    best = _greatest(nodes, log_likelihoods.sum(axis=0))
    return DispersionFit(float(np.exp(best)), best in (low, high), nodes, log_likelihoods)


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
