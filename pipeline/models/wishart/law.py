"""Random Jacobian J = J₁BJ₂ with B ~ W_m(d, I/d) (Eqs. LUDecom, Thetaa; Algorithm 1).

One step needs only B⁻¹a, a = J₁⁻¹v, and its law is exact: with r = ‖a‖, R orthonormal, Re₁ = a/r,

    B⁻¹a = r·R·[z, z·T]ᵀ,   z = d/χ²(d − m + 1),   T = N(0, I_{m−1})/sqrt(χ²(d − m + 2)),

z and T independent. Its density at w, u = w/r, u₁ = eᵀu > 0 along e = a/r, u⊥ the rest, is

    p(w) = r⁻ᵐ·p_z(u₁)·p_T(‖u⊥‖/u₁)·u₁^{−(m−1)},

z inverse-gamma of shape (d−m+1)/2 and scale d/2, T of density ∝ (1 + ‖t‖²)^{−(d+1)/2}. The
covariance of a step is Var z along a and c = E z²/(d − m) across it:

    tr Cov = c·‖a‖²‖J₂⁺‖_F² + (Var z − c)·‖J₂⁺a‖².
"""

from dataclasses import dataclass, replace
from math import lgamma
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.interface import Chain, Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import (
    GIVEN_LAW,
    PIVOTED_LU_LAW,
    QR_LAW,
    QR_TRANSPOSED_LAW,
    Law,
    row_by_row,
    task_step,
)
from pipeline.models.normal import normal_log_density, principal_axes
from pipeline.models.wishart.decomposition import PIVOTED_LU, Decomposition, factors
from pipeline.randommatrix.wishart import degrees_of_freedom, largest_dispersion

KINDS = {
    "pivoted_lu": PIVOTED_LU_LAW,
    "qr": QR_LAW,
    "qr_transposed": QR_TRANSPOSED_LAW,
    "given": GIVEN_LAW,
}
# of ln(d − m − 3): from dispersions at the limit of the covariance to a step without noise
LOG_EXCESS = (-12.0, 60.0)


@dataclass(frozen=True)
class WishartModel:
    """Random Jacobian of dispersion ``sigma_b`` σ_B around J₁J₂ of a ``decomposition``, Eq.
    (LUDecom); a step is Eq. (RMTInvDiff), of the law of Algorithm 1, without noise in the null
    space of J. Raises ModelDomainError for a σ_B that is not positive; with a chain, for one
    without a density and a given J₁ of another size.
    """

    sigma_b: float
    decomposition: Decomposition = PIVOTED_LU

    def __post_init__(self) -> None:
        if not 0 < self.sigma_b < np.inf:
            raise ModelDomainError("sigma_B must be positive and finite", sigma_B=self.sigma_b)

    def law(self, chain: Chain) -> Law:
        m = len(chain.task)
        self.decomposition.require_size(m)
        d = degrees_of_freedom(self.sigma_b, m)
        # three task rows take one χ² variate and two normals, one row has no direction
        # (:mod:`pipeline.models.kernel`)
        degrees = (d - m + 1,) if m in (1, 3) else (d - m + 1, d - m + 2)
        parameters = np.array([d])
        if self.decomposition.left is not None:
            left = np.array(self.decomposition.left)
            both = [row_by_row(each, m) for each in (left, np.linalg.inv(left))]
            parameters = np.concatenate([parameters, *both])
        kind = KINDS[self.decomposition.name]
        return Law(kind, parameters, sets=1, each=m - 1, degrees=np.array(degrees, dtype=float))

    def mean(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n) q + d/(d−m−1)·J⁺v and the null-space step in rad; ModelDomainError for
        σ_B ≥ 1.
        """
        m = len(chain.task)
        d = _degrees_with_moments(self.sigma_b, 1, m)
        perturbed = chain.nominal_step(q, task_step(chain, v))
        return q + chain.null_step(q, v) + d / (d - m - 1) * perturbed

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        a, back, _ = factors(chain, q, v, self.decomposition)
        return step_covariance(a, back, self.sigma_b)

    def with_trace(self, chain: Mechanism, q: ndarray, v: ndarray, trace: float) -> "WishartModel":
        a, back, _ = factors(chain, q, v, self.decomposition)
        squares = StepSquares(*(each.mean() for each in step_squares(a, back)))
        return replace(self, sigma_b=dispersion_of_trace(squares, trace, a.shape[-1]))

    def sample(self, chain: Chain, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        """(..., n) q, J₂⁺B⁻¹a and the step in the null space of J."""
        a, back, _ = factors(chain, q, v, self.decomposition)
        m, d = a.shape[-1], degrees_of_freedom(self.sigma_b, a.shape[-1])
        z = d / rng.chisquare(d - m + 1, a.shape[:-1])
        t = rng.standard_normal((*a.shape[:-1], m - 1))
        t /= np.sqrt(rng.chisquare(d - m + 2, (*a.shape[:-1], 1)))
        r = np.sqrt(np.vecdot(a, a))
        turned = frames(np.where(r[..., None] > 0, a, np.eye(m)[0]))
        drawn = (r * z)[..., None] * (turned[..., 0] + np.matvec(turned[..., 1:], t))
        return q + chain.null_step(q, v) + np.matvec(back, drawn)

    def log_density(
        self, chain: Mechanism, q: ndarray, v: ndarray, q_next: ndarray, measurement=None
    ) -> ndarray:
        """(...,) ln of the exact density of a step, |det J₂|·p(B⁻¹a) at J₂(q_next − q), a = J₁⁻¹v:
        −inf where no B > 0 gives the step, ModelDomainError where v = 0 or n > m. With
        ``measurement`` by quadrature, at rest N(q, measurement).
        """
        batch = np.broadcast_shapes(q.shape[:-1], v.shape[:-1], q_next.shape[:-1])
        q, v, q_next = (np.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, v, q_next))
        step = q_next - q - chain.null_step(q, v)
        a, back, log_determinant = factors(chain, q, v, self.decomposition)
        n, m = back.shape[-2:]
        d = degrees_of_freedom(self.sigma_b, m)
        moving = np.any(task_step(chain, v), axis=-1)
        if measurement is not None:
            _ = principal_axes(measurement)  # refuses what is not a covariance
            result = np.array(normal_log_density(step, measurement))
            from pipeline.models.wishart.quadrature import blurred_log_density  # the compiler

            steps = step[moving], a[moving], back[moving]
            result[moving] = blurred_log_density(*steps, measurement, d)
            return result
        if n > m or not np.all(moving):
            where = f"on a plane ({n} joints and {m} task rows)"
            if n == m:
                where = f"at rest, as at {int(np.sum(~moving))} of {moving.size} step(s)"
            raise ModelDomainError(
                f"a step of the matrix model has no density {where}; "
                "give the covariance of the measurement noise"
            )
        return action_log_density(np.matvec(np.linalg.inv(back), step), a, d) + log_determinant


def build(parameters: dict[str, Any]) -> WishartModel:
    """Build the model from its ``sigma_b``, ``decomposition`` and, where it is given, ``left``."""
    decomposition = Decomposition(parameters["decomposition"], parameters.get("left"))
    return WishartModel(parameters["sigma_b"], decomposition)


def action_log_density(w: ndarray, a: ndarray, d: float) -> ndarray:
    """(...,) log density of B⁻¹a at ``w`` (..., m), ``a`` (..., m) not zero; −inf where wᵀa ≤ 0."""
    m = a.shape[-1]
    r = np.sqrt(np.vecdot(a, a))
    e, u = a / r[..., None], w / r[..., None]
    along = np.vecdot(e, u)
    inside = along > 0
    z = np.where(inside, along, 1.0)
    t = (u - along[..., None] * e) / z[..., None]
    shape = (d - m + 1) / 2
    z_term = shape * np.log(d / 2) - lgamma(shape) - (shape + 1) * np.log(z) - d / (2 * z)
    t_term = lgamma((d + 1) / 2) - lgamma((d - m + 2) / 2) - (m - 1) / 2 * np.log(np.pi)
    t_term = t_term - (d + 1) / 2 * np.log1p(np.vecdot(t, t))
    return np.where(inside, z_term + t_term - m * np.log(r) - (m - 1) * np.log(z), -np.inf)


def frames(a: ndarray) -> ndarray:
    """(..., m, m) orthonormal matrices of first column a/‖a‖, for ``a`` (..., m) not zero:
    Householder's reflection with its sign changed.
    """
    r = np.sqrt(np.vecdot(a, a))
    sign = np.where(a[..., 0] < 0, -1.0, 1.0)
    mirror = a.copy()
    mirror[..., 0] += sign * r
    reach = (r * (r + np.abs(a[..., 0])))[..., None, None]
    reflection = np.eye(a.shape[-1]) - mirror[..., :, None] * mirror[..., None, :] / reach
    return -sign[..., None, None] * reflection


def step_covariance(a: ndarray, back: ndarray, sigma_b: float) -> ndarray:
    """(..., n, n) Cov(J₂⁺B⁻¹a) = r²c·J₂⁺J₂⁺ᵀ + (Var z − c)·(J₂⁺a)(J₂⁺a)ᵀ for ``a`` (..., m),
    ``back`` J₂⁺ (..., n, m) and σ_B ``sigma_b``; ModelDomainError for σ_B ≥ sqrt((m+1)/(m+3)).
    """
    m = a.shape[-1]
    variance, across = step_variances(_degrees_with_moments(sigma_b, 2, m), m)
    mean = np.matvec(back, a)
    size = across * np.vecdot(a, a)[..., None, None]
    along = (variance - across) * mean[..., :, None] * mean[..., None, :]
    # einsum, as matmul takes three times as long for matrices this small
    return size * np.einsum("...ij,...kj->...ik", back, back) + along


def _degrees_with_moments(sigma_b: float, moments: int, m: int) -> float:
    """d, where the first ``moments`` moments of B⁻¹ (m, m) exist."""
    limit = largest_dispersion(m, inverse_moments=moments)
    if not sigma_b < limit:
        name = ("mean", "covariance")[moments - 1]
        message = f"the {name} of a Wishart step exists only for sigma_B below {limit:.4g}"
        raise ModelDomainError(message, sigma_B=sigma_b)
    return degrees_of_freedom(sigma_b, m)


def step_variances(d: float, m: int) -> tuple[float, float]:
    """Var z and c = E z²/(d − m), the variances of B⁻¹a along and across a unit a, B (m, m)."""
    square = d**2 / ((d - m - 1) * (d - m - 3))
    return 2 * d**2 / ((d - m - 1) ** 2 * (d - m - 3)), square / (d - m)


class StepSquares(NamedTuple):
    """Squared lengths in rad² of steps, or their means."""

    every: ndarray  # ‖a‖²‖J₂⁺‖_F², as if the noise had every direction of a
    nominal: ndarray  # ‖J₂⁺a‖², of the nominal step


def step_squares(a: ndarray, back: ndarray) -> StepSquares:
    """Squared lengths (...,) of the steps of ``a`` J₁⁻¹v (..., m) and ``back`` J₂⁺ (..., n, m)."""
    mean, every = np.matvec(back, a), np.einsum("...ij,...ij->...", back, back)
    return StepSquares(np.vecdot(a, a) * every, np.vecdot(mean, mean))


def dispersion_of_trace(squares: StepSquares, trace: float, m: int) -> float:
    """σ_B at which steps of these mean ``squares`` have the mean ``trace`` in rad² of their
    covariance, B (m, m), which grows with σ_B. Raises ModelDomainError for a trace that is not
    positive, for steps at rest, and where σ_B would be at its limit sqrt((m + 1)/(m + 3)) to
    rounding.
    """
    from scipy.optimize import brentq  # here, as what loads a model does without SciPy

    if not (trace > 0 and squares.every > 0):
        raise ModelDomainError(
            "no sigma_B: a Wishart step needs a positive variance, and a motion that is not at "
            "rest at every step",
            trace_rad2=trace,
        )

    def excess(x: float) -> float:
        along, across = step_variances(m + 3 + np.exp(x), m)
        own = across * squares.every + (along - across) * squares.nominal
        return float(np.log(own / trace))

    low, high = LOG_EXCESS
    if not excess(low) > 0:
        raise ModelDomainError(
            "the variance of a Wishart step needs a sigma_B at the limit of its covariance, "
            f"{largest_dispersion(m, inverse_moments=2):.4g}",
            trace_rad2=trace,
        )
    d = m + 3 + np.exp(brentq(excess, low, high, xtol=1e-12, rtol=1e-14))
    return float(np.sqrt((m + 1) / d))
