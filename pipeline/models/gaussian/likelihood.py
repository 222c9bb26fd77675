"""Maximum likelihood of (α, u) of the Gaussian matrix model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.models.commands import task_step
from pipeline.models.covariance import principal_axes
from pipeline.models.density import axis_log_density
from pipeline.models.gaussian.law import noise_scale
from pipeline.models.gaussian.ridge import GaussianFit, search
from pipeline.models.norm import frobenius
from pipeline.models.steps import moving_steps

ALPHA_RANGE = 30.0  # α is sought within this factor of what the second moments suggest
TOLERANCE = 1e-4  # of ln α


def fit_alpha_u(
    chain: PlanarChain,
    q: np.ndarray,
    v: np.ndarray,
    noise: np.ndarray,
    measurement: np.ndarray,
    extensions: np.ndarray,
) -> GaussianFit:
    """(α̂, û) and the ridge: the greatest likelihood over α for each u = max ‖J⁺‖_F·(1 +
    extension), and the best of these, refined.

    The maximum is over all recorded poses with a command, so that no recorded step is beyond the
    bound. ``objective`` of the fit is −Σ ln p over the steps with a command, where p is the exact
    density of a step plus the measurement noise. Raises SingularJacobianError and ModelDomainError.

    Args:
        chain: of n joints.
        q: (takes, M, n) measured poses in rad before each step.
        v: (M, m) or longer, commands.
        noise: (takes, M, n) ω of each step in rad.
        measurement: (n, n) Σ_m in rad², without which the slowest steps would decide everything.
        extensions: (G ≥ 3,) shares of that maximum, ascending and positive.
    """
    from scipy.optimize import minimize_scalar

    q, v, noise = moving_steps(q, v, noise)
    inverse, v = chain.inverse_jacobian(q), task_step(chain, v)
    norms, speeds = frobenius(inverse), np.vecdot(v, v)
    largest = float(norms.max())
    squared = float(np.mean(noise**2))
    least, axes = principal_axes(measurement)
    parts = (noise @ axes) ** 2  # along the axes of Σ_m, which every α leaves as they are

    def best(extension: float) -> tuple[float, float]:
        gain = noise_scale(norms, 1.0, largest * (1 + extension), *inverse.shape[-2:]) * speeds

        def cost(log_alpha: float) -> float:
            return -float(axis_log_density(parts, np.exp(2 * log_alpha) * gain, least).sum())

        middle = 0.5 * np.log(squared / gain.mean())
        bounds = (middle - np.log(ALPHA_RANGE), middle + np.log(ALPHA_RANGE))
        result = minimize_scalar(
            cost, bounds=bounds, method="bounded", options={"xatol": TOLERANCE}
        )
        return float(result.fun), float(np.exp(result.x))

    shares = search(best, extensions, 1.0)
    return replace(
        shares,
        u=largest * shares.u,
        extension=largest * shares.extension,
        extensions=largest * shares.extensions,
    )
