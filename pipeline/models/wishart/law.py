"""The random Jacobian of maximum entropy: J = J₁BJ₂ with B ~ W_n(d, I/d) (Eqs. LUDecom, Thetaa;
Algorithm 1).

One step needs only B⁻¹a, a = J₁⁻¹v, and its law is exact: with r = ‖a‖ and R orthonormal of first
column a/r,

    B⁻¹a = r·R·[z, z·T]ᵀ,   z = d/χ²(d − n + 1),   T = N(0, I_{n−1})/sqrt(χ²(d − n + 2)),

z and T independent. So no matrix is drawn or inverted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import JOINTS, PlanarChain
from pipeline.core.errors import ModelDomainError
from pipeline.models.density import normal_log_density
from pipeline.models.model import Law
from pipeline.models.wishart.decomposition import LU, Decomposition
from pipeline.models.wishart.density import action_log_density, blurred_log_density
from pipeline.models.wishart.factors import factors
from pipeline.randommatrix.wishart import degrees_of_freedom, largest_dispersion


@dataclass(frozen=True)
class WishartModel:
    """Random Jacobian of dispersion ``sigma_b`` σ_B around J₁J₂ of a ``decomposition``.

    J₁BJ₂ is Eq. (LUDecom), and a step through its inverse Eq. (RMTInvDiff), whose law is that of
    Algorithm 1. Raises ModelDomainError where σ_B has no density or
    the decomposition another size; a covariance or a density raises
    it where a pivot of LU without pivoting is small.
    """

    sigma_b: float
    decomposition: Decomposition = LU

    def __post_init__(self) -> None:
        self.decomposition.require_size(JOINTS, JOINTS)
        degrees_of_freedom(self.sigma_b, JOINTS)

    def law(self) -> Law:
        """A step, compiled."""
        from pipeline.models.law import row_by_row  # here, as it loads the compiler
        from pipeline.models.wishart import step

        d, n = degrees_of_freedom(self.sigma_b, JOINTS), JOINTS
        match self.decomposition:
            case Decomposition("lu", rows=rows, order=order):
                ordered, columns = (np.eye(n)[list(each or range(n))] for each in (rows, order))
                move, matrices = step.lu, (ordered, ordered.T, columns)
            case Decomposition("pivoted_lu"):
                move, matrices = step.pivoted_lu, ()
            case Decomposition("qr_transposed"):
                move, matrices = step.qr_transposed, ()
            case Decomposition(left=given):
                left = np.eye(n) if given is None else np.array(given)
                move, matrices = step.given_factor, (left, np.linalg.inv(left))
        parameters = np.array([d, *(number for each in matrices for number in row_by_row(each))])
        return Law(move, parameters, normals=(1, n - 1), degrees=d - (n - 1))

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n) q + d/(d−n−1)·J⁻¹v: longer than the nominal step. Raises ModelDomainError for
        σ_B ≥ 1, where it does not exist.
        """
        n = q.shape[-1]
        d = _degrees_with_moments(self.sigma_b, 1, n)
        return q + d / (d - n - 1) * np.matvec(chain.inverse_jacobian(q), v)

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n, n) in rad², by :func:`step_covariance`; raises what it raises."""
        a, back, _ = factors(chain, q, v, self.decomposition)
        return step_covariance(a, back, self.sigma_b)

    def log_density(
        self,
        chain: PlanarChain,
        q: np.ndarray,
        v: np.ndarray,
        q_next: np.ndarray,
        measurement: np.ndarray | None = None,
    ) -> np.ndarray:
        """(...,) |det J₂|·p(B⁻¹a) at J₂(q_next − q), a = J₁⁻¹v: the exact one-step density.

        Without ``measurement`` −inf where no B > 0 gives the step (aᵀJ₂(q_next − q) ≤ 0), and
        ModelDomainError where v = 0: there q_{k+1} = q has all the probability. With it both are
        ordinary values, by quadrature, at rest those of N(q, measurement). Raises ModelDomainError
        where ``measurement`` is not positive definite.
        """
        q, v, q_next = np.broadcast_arrays(q, v, q_next)
        d = degrees_of_freedom(self.sigma_b, q.shape[-1])
        step = q_next - q
        a, back, log_determinant = factors(chain, q, v, self.decomposition)
        forward = np.linalg.inv(back)
        action = np.matvec(forward, step)
        moving = np.any(v, axis=-1)
        if measurement is None:
            if not np.all(moving):
                raise ModelDomainError(
                    "a step of the matrix model has no density at rest, as at "
                    f"{int(np.count_nonzero(~moving))} of {moving.size} step(s); "
                    "give the covariance of the measurement noise"
                )
            return action_log_density(action, a, d) + log_determinant
        at_rest = normal_log_density(step, 0.0, measurement)
        noise = forward @ measurement @ np.swapaxes(forward, -1, -2)
        result = np.array(at_rest)
        result[moving] = blurred_log_density(action[moving], a[moving], noise[moving], d)
        result[moving] += log_determinant[moving]
        return result


def step_covariance(a: np.ndarray, back: np.ndarray, sigma_b: float) -> np.ndarray:
    """(..., n, n) Cov(J₂⁺B⁻¹a) = r²c·J₂⁺J₂⁺ᵀ + (Var z − c)·(J₂⁺a)(J₂⁺a)ᵀ, c = E z²/(d−m), for ``a``
    (..., m), ``back`` J₂⁺ (..., n, m) and σ_B ``sigma_b``.

    Raises ModelDomainError for σ_B ≥ sqrt((m+1)/(m+3)), where it does not exist.
    """
    m = a.shape[-1]
    d = _degrees_with_moments(sigma_b, 2, m)
    square = d**2 / ((d - m - 1) * (d - m - 3))
    variance = 2 * d**2 / ((d - m - 1) ** 2 * (d - m - 3))
    across, mean = square / (d - m), np.matvec(back, a)
    size = across * np.vecdot(a, a)[..., None, None]
    along = (variance - across) * mean[..., :, None] * mean[..., None, :]
    # einsum, as matmul takes three times as long for matrices this small
    return size * np.einsum("...ij,...kj->...ik", back, back) + along


def _degrees_with_moments(sigma_b: float, moments: int, n: int) -> float:
    """d, where the first ``moments`` moments of B⁻¹ (n, n) exist."""
    limit = largest_dispersion(n, inverse_moments=moments)
    if not sigma_b < limit:
        name = ("mean", "covariance")[moments - 1]
        raise ModelDomainError(
            f"the {name} of a Wishart step exists only for sigma_B below {limit:.4g}",
            sigma_B=sigma_b,
        )
    return degrees_of_freedom(sigma_b, n)
