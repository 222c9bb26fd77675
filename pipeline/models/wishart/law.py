"""Random Jacobian J = J₁BJ₂ with B ~ W_m(d, I/d) (Eqs. LUDecom, Thetaa; Algorithm 1).

A step depends on B only by B⁻¹a, a = J₁⁻¹v. With r = ‖a‖, R orthonormal and Re₁ = a/r, exactly

    B⁻¹a = r·R·[z, z·T]ᵀ,   z = d/χ²(d − m + 1),   T = N(0, I_{m−1})/sqrt(χ²(d − m + 2)),

z and T independent. With u = w/r, u₁ = eᵀu > 0 along e = a/r and u⊥ across it the density at w is

    p(w) = r⁻ᵐ·p_z(u₁)·p_T(‖u⊥‖/u₁)·u₁^{−(m−1)},

z inverse-gamma of shape (d−m+1)/2 and scale d/2, T of density ∝ (1 + ‖t‖²)^{−(d+1)/2}. The
variance of B⁻¹a for ‖a‖ = 1 is Var z along a and c = E z²/(d − m) across it:

    tr Cov = c·‖a‖²‖J₂⁺‖_F² + (Var z − c)·‖J₂⁺a‖².
"""

from dataclasses import dataclass, replace
from math import lgamma
from typing import Any, ClassVar

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import Chain
from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import (
    WISHART_LAWS,
    Law,
    MotionModel,
    Traits,
    normal_log_density,
    principal_axes,
    task_step,
)
from pipeline.models.wishart.decomposition import (
    PIVOTED_LU,
    Decomposition,
    factors,
    frames,
)
from pipeline.randommatrix.wishart import degrees_of_freedom, largest_dispersion

LEAST_DISPERSION = 1e-15  # σ_B below which d = (m + 1)/σ_B² has no use as a double
# ends of ln(d − m − 3): σ_B at the limit of the covariance, and a noise-free step
LOG_EXCESS = (-12.0, 60.0)


@dataclass(frozen=True)
class WishartModel(MotionModel):
    """Random Jacobian J₁BJ₂ with the dispersion ``sigma_b`` σ_B for a ``decomposition``, Eq.
    (LUDecom). A step, Eq. (RMTInvDiff), has the law of Algorithm 1 and no noise in the null space
    of J. Raises ModelDomainError for σ_B < LEAST_DISPERSION. Its methods raise ModelDomainError
    for a σ_B without a density.
    """

    traits: ClassVar = Traits(noisy_at_rest=False, needs_jacobian=True)
    sigma_b: float
    decomposition: Decomposition = PIVOTED_LU

    def __post_init__(self) -> None:
        if not LEAST_DISPERSION <= self.sigma_b < np.inf:
            raise ModelDomainError(
                f"sigma_B must be at least {LEAST_DISPERSION:g} and finite",
                sigma_B=self.sigma_b,
            )

    def law(self, chain: Chain) -> Law:
        m = len(chain.task)
        d = degrees_of_freedom(self.sigma_b, m)
        # one χ² variate is enough for three task rows (models.kernel) and for one
        degrees = (d - m + 1,) if m in (1, 3) else (d - m + 1, d - m + 2)
        kind = WISHART_LAWS[self.decomposition.name]
        return Law(kind, np.array([d]), m - 1, np.array(degrees, dtype=float))

    def mean(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n) q + d/(d−m−1)·J⁺v + the null-space step in rad; ModelDomainError for σ_B ≥ 1."""
        m = len(chain.task)
        d = _degrees_with_moments(self.sigma_b, 1, m)
        perturbed = chain.nominal_step(q, task_step(chain, v))
        return q + chain.null_step(q, v) + d / (d - m - 1) * perturbed

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        a, back, _ = factors(chain, q, v, self.decomposition)
        return step_covariance(a, back, self.sigma_b)

    def with_trace(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        trace: float,
    ) -> "WishartModel":
        a, back, _ = factors(chain, q, v, self.decomposition)
        every, nominal = step_squares(a, back)
        means = every.mean(), nominal.mean()
        return replace(self, sigma_b=dispersion_of_trace(*means, trace, a.shape[-1]))

    def sample(self, chain: Chain, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        """(..., n) q + J₂⁺B⁻¹a + the step in the null space of J, in rad."""
        a, back, _ = factors(chain, q, v, self.decomposition)
        *batch, m = a.shape
        d = degrees_of_freedom(self.sigma_b, m)
        z = d / rng.chisquare(d - m + 1, batch)
        t = rng.standard_normal((*batch, m - 1))
        t /= np.sqrt(rng.chisquare(d - m + 2, (*batch, 1)))

        r = np.sqrt(np.vecdot(a, a))
        moving = r[..., None] > 0
        axes = frames(np.where(moving, a, np.eye(m)[0]))
        direction = axes[..., 0] + np.matvec(axes[..., 1:], t)
        length = r * z
        action = length[..., None] * direction
        return q + chain.null_step(q, v) + np.matvec(back, action)

    def log_density(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        q_next: ndarray,
        measurement=None,
    ) -> ndarray:
        """(...,) ln of the exact density of a step, |det J₂|·p(B⁻¹a) at J₂(q_next − q), a = J₁⁻¹v:
        −inf if no B > 0 gives the step, ModelDomainError for v = 0 or n > m. With ``measurement``
        by quadrature, at rest N(q, measurement).
        """
        batch = np.broadcast_shapes(q.shape[:-1], v.shape[:-1], q_next.shape[:-1])
        q, v, q_next = (
            np.broadcast_to(rows, (*batch, rows.shape[-1])) for rows in (q, v, q_next)
        )
        step = q_next - q - chain.null_step(q, v)
        a, back, log_determinant = factors(chain, q, v, self.decomposition)
        n, m = back.shape[-2:]
        d = degrees_of_freedom(self.sigma_b, m)
        moving = np.any(task_step(chain, v), axis=-1)
        if measurement is not None:
            from pipeline.models.wishart import quadrature  # here: it loads numba

            _ = principal_axes(measurement)  # raises if it is no covariance
            result = np.array(normal_log_density(step, measurement))
            steps = step[moving], a[moving], back[moving]
            result[moving] = quadrature.blurred_log_density(*steps, measurement, d)
            return result
        if n > m:
            raise _no_density(f"on a plane ({n} joints and {m} task rows)")
        if not np.all(moving):
            at_rest = int(np.sum(~moving))
            raise _no_density(f"at rest, as at {at_rest} of {moving.size} step(s)")
        action = np.matvec(np.linalg.inv(back), step)
        return action_log_density(action, a, d) + log_determinant


def _no_density(where: str) -> ModelDomainError:
    return ModelDomainError(
        f"a step of the matrix model has no density {where}; give the covariance of the "
        "measurement noise",
    )


def build(parameters: dict[str, Any]) -> WishartModel:
    """Build the model from its ``sigma_b`` and ``decomposition``."""
    decomposition = Decomposition(parameters["decomposition"])
    return WishartModel(parameters["sigma_b"], decomposition)


def action_log_density(w: ndarray, a: ndarray, d: float) -> ndarray:
    """(...,) log density of B⁻¹a at ``w`` (..., m), ``a`` (..., m) not zero; −inf for wᵀa ≤ 0."""
    m = a.shape[-1]
    r = np.sqrt(np.vecdot(a, a))
    e = a / r[..., None]
    u = w / r[..., None]
    along = np.vecdot(e, u)
    z = np.where(along > 0, along, 1.0)
    log_z = np.log(z)
    across = u - along[..., None] * e
    t = across / z[..., None]

    # ln p_z, inverse-gamma
    shape = (d - m + 1) / 2
    constant = shape * np.log(d / 2) - lgamma(shape)
    z_density = constant - (shape + 1) * log_z - d / (2 * z)
    # ln p_T
    constant = lgamma((d + 1) / 2) - lgamma((d - m + 2) / 2)
    constant -= (m - 1) / 2 * np.log(np.pi)
    square = np.vecdot(t, t)
    t_density = constant - (d + 1) / 2 * np.log1p(square)

    density = z_density + t_density - m * np.log(r) - (m - 1) * log_z
    return np.where(along > 0, density, -np.inf)


def step_covariance(a: ndarray, back: ndarray, sigma_b: float) -> ndarray:
    """(..., n, n) Cov(J₂⁺B⁻¹a) = r²c·J₂⁺J₂⁺ᵀ + (Var z − c)·(J₂⁺a)(J₂⁺a)ᵀ for ``a`` (..., m),
    ``back`` J₂⁺ (..., n, m) and σ_B ``sigma_b``; ModelDomainError for σ_B ≥ sqrt((m+1)/(m+3)).
    """
    m = a.shape[-1]
    variance, across = step_variances(_degrees_with_moments(sigma_b, 2, m), m)
    mean = np.matvec(back, a)
    square = np.vecdot(a, a)
    size = across * square[..., None, None]
    along = (variance - across) * mean[..., :, None] * mean[..., None, :]
    # einsum: matmul takes three times as long for small matrices
    outer = np.einsum("...ij,...kj->...ik", back, back)
    return size * outer + along


def _degrees_with_moments(sigma_b: float, moments: int, m: int) -> float:
    """d; raises ModelDomainError if the first ``moments`` moments of B⁻¹ (m, m) do not exist."""
    limit = largest_dispersion(m, inverse_moments=moments)
    if not sigma_b < limit:
        name = ("mean", "covariance")[moments - 1]
        message = f"the {name} of a Wishart step exists only for sigma_B below"
        raise ModelDomainError(f"{message} {limit:.4g}", sigma_B=sigma_b)
    return degrees_of_freedom(sigma_b, m)


def step_variances(d: float, m: int) -> tuple[float, float]:
    """Var z and c = E z²/(d − m), the variances of B⁻¹a along and across a unit a, B (m, m)."""
    mean_square = d**2 / ((d - m - 1) * (d - m - 3))
    along = 2 * d**2 / ((d - m - 1) ** 2 * (d - m - 3))
    across = mean_square / (d - m)
    return along, across


def step_squares(a: ndarray, back: ndarray) -> tuple[ndarray, ndarray]:
    """‖a‖²‖J₂⁺‖_F², ‖J₂⁺a‖² (...,) in rad² of ``a`` J₁⁻¹v (..., m) and ``back`` J₂⁺ (..., n, m)."""
    mean = np.matvec(back, a)
    every = np.einsum("...ij,...ij->...", back, back)
    return np.vecdot(a, a) * every, np.vecdot(mean, mean)


def dispersion_of_trace(every: float, nominal: float, trace: float, m: int) -> float:
    """Return σ_B of B (m, m) at which steps with the mean :func:`step_squares` ``every`` and
    ``nominal`` have the mean covariance ``trace`` in rad². Raises ModelDomainError for trace ≤ 0,
    for steps at rest, and if σ_B would reach its limit sqrt((m + 1)/(m + 3)).
    """
    from scipy.optimize import brentq  # here: loading a model does not need SciPy

    if not (trace > 0 and every > 0):
        message = "no sigma_B: a Wishart step needs a positive variance and a motion that is not "
        raise ModelDomainError(message + "at rest at every step", trace_rad2=trace)

    def excess(x: float) -> float:
        along, across = step_variances(m + 3 + np.exp(x), m)
        modelled = across * every + (along - across) * nominal
        return float(np.log(modelled / trace))

    low, high = LOG_EXCESS
    if not excess(low) > 0:
        limit = f"the limit {largest_dispersion(m, inverse_moments=2):.4g} of a finite covariance"
        message = f"a Wishart step with this variance would need sigma_B at {limit}"
        raise ModelDomainError(message, trace_rad2=trace)
    d = m + 3 + np.exp(brentq(excess, low, high, xtol=1e-12, rtol=1e-14))
    return float(np.sqrt((m + 1) / d))
