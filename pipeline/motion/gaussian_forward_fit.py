"""Maximum likelihood of (α, u) of the forward Gaussian matrix model, whose moments, and so the paper's objective, do not exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebval, chebvander
from scipy.optimize import minimize_scalar

from pipeline.arm.chain import PlanarChain
from pipeline.motion.gaussian import frobenius, noise_scale
from pipeline.motion.gaussian_fit import GaussianFit, search
from pipeline.motion.gaussian_forward_blur import blurred_log_density
from pipeline.motion.likelihood import TOLERANCE, moving_steps

STD_RANGE = 5.0  # √s is sought within this factor of what the second moments of the recorded steps suggest
DEGREE = 16  # of the polynomials in ln s: they leave about 1e-4 nat a step


@dataclass(frozen=True)
class ForwardLikelihood:
    """ln p of every recorded step with a command as a function of s, which is all of (α, u) that it depends on."""

    norms: np.ndarray  # (takes, M') ‖J‖_F at the recorded poses
    middle: float  # of the interval of ln s
    half: float  # of its length
    coefficients: np.ndarray  # (DEGREE + 1, takes, M') of Chebyshev's polynomials on that interval

    def of(self, takes: np.ndarray) -> ForwardLikelihood:
        """That of the takes with these numbers, as often as each is named: no density is computed again."""
        return ForwardLikelihood(self.norms[takes], self.middle, self.half, self.coefficients[:, takes])

    def fit(self, extensions: np.ndarray) -> GaussianFit:
        """(α̂, û) and the ridge: the greatest likelihood over α for each u = max ‖J‖_F·(1 + extension), and the best of these, refined.

        The maximum is over the recorded poses with a command, and ``extensions`` (G ≥ 3, ascending, positive) are shares of it.
        ``objective`` is −Σ ln p; ``at_end`` also says that α̂ is at an end of its interval. The data determine α·sqrt(u² − ‖J‖²) and
        hardly more: read the ridge.
        """
        largest = float(self.norms.max())

        def log_gain(extension: float) -> np.ndarray:
            return np.log(noise_scale(self.norms, 1.0, largest * (1 + extension), 3))

        def interval(gain: np.ndarray) -> np.ndarray:
            """(2,) of ln α, in which no step's s leaves the interval of the interpolation."""
            return np.array([self.middle - self.half - gain.min(), self.middle + self.half - gain.max()]) / 2

        def best(extension: float) -> tuple[float, float]:
            gain = log_gain(extension)

            def cost(log_alpha: float) -> float:
                return -float(chebval((2 * log_alpha + gain - self.middle) / self.half, self.coefficients, tensor=False).sum())

            found = minimize_scalar(cost, bounds=interval(gain), method="bounded", options={"xatol": TOLERANCE})
            return float(found.fun), float(np.exp(found.x))

        found = search(best, extensions)
        ends = interval(log_gain(found.extension))
        at_end = found.at_end or bool(np.abs(np.log(found.alpha) - ends).min() < 10 * TOLERANCE)
        return GaussianFit(
            found.alpha, largest * (1 + found.extension), largest * found.extension, found.objective, at_end,
            largest * extensions, found.objectives, found.alphas,
        )  # fmt: skip


def forward_likelihood(chain: PlanarChain, q: np.ndarray, v: np.ndarray, noise: np.ndarray, measurement: np.ndarray) -> ForwardLikelihood:
    """The likelihood of recorded steps by quadrature at DEGREE + 1 values of ln s for each.

    ``q`` (takes, M, 3) measured poses in rad before each step, ``v`` (M, 3) commanded steps (m, m, rad), ``noise`` ω (takes, M, 3) in rad,
    ``measurement`` Σ_m (3, 3) in rad². Raises SingularJacobianError and ModelDomainError.
    """
    takes = len(q)
    q, v, noise = moving_steps(q, v, noise)
    jacobian = chain.jacobian(q)
    step = np.matvec(chain.inverse_jacobian(q), v) + noise
    # J̲x = v − J_ν x, so that the image of the noise has the variance s‖x‖² in each of its three entries
    middle = float(np.log(np.sum(np.matvec(jacobian, noise) ** 2) / (3 * np.sum(step**2))))
    half = 2 * np.log(STD_RANGE)
    nodes = chebpts1(DEGREE + 1)
    values = [blurred_log_density(step, v, jacobian, np.full(len(q), np.exp(middle + half * x)), measurement) for x in nodes]
    coefficients = np.linalg.solve(chebvander(nodes, DEGREE), np.stack(values))
    return ForwardLikelihood(frobenius(jacobian).reshape(takes, -1), middle, half, coefficients.reshape(DEGREE + 1, takes, -1))
