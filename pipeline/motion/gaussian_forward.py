"""The Gaussian random matrix model of the Jacobian itself: J ~ N_{n,n}(J̲, I⊗Σ_k) (Eqs. GausMod–const2; Algorithm 2 as printed).

A step is q_{k+1} = q_k + (J̲(q_k) + J_ν)⁻¹v with the rows of J_ν independent and N(0, Σ_k), Σ_k = s·I. The normal law puts density on
singular matrices, so that no moment of the step exists. With R orthonormal of first column v/‖v‖ and a₁, a₂, a₃ the rows of Rᵀ(J̲ + J_ν),
the equations a₂·x = a₃·x = 0 and a₁·x = ‖v‖ say

    x = ‖v‖·c/(a₁·c),   c = a₂ × a₃,   and given c   a₁·c ~ N(m₁·c, s‖c‖²),   m₁ = J̲ᵀv/‖v‖.

So a draw takes seven normals and a cross product, and no system is solved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ModelDomainError
from pipeline.motion.density import normal_log_density
from pipeline.motion.gaussian import frobenius, noise_scale
from pipeline.motion.gaussian_forward_blur import blurred_log_density
from pipeline.motion.gaussian_forward_density import action_log_density
from pipeline.motion.model import Law
from pipeline.motion.wishart_density import frames


def sample_inverse_action(jacobian: np.ndarray, v: np.ndarray, s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(..., 3) one draw of (J̲ + J_ν)⁻¹v for each ``jacobian`` J̲ (..., 3, 3), with ``v`` (3,) or (..., 3) and ``s`` (...,) ≥ 0.

    Zero where v is zero. A singular draw has probability zero.
    """
    speed = np.sqrt(np.vecdot(v, v))
    turn = frames(np.where(speed[..., None] > 0, v, [1.0, 0.0, 0.0]))
    rows = np.swapaxes(turn, -1, -2) @ jacobian
    std = np.sqrt(s)[..., None]
    noise = rng.standard_normal((*s.shape, 7))
    c = np.cross(rows[..., 1, :] + std * noise[..., :3], rows[..., 2, :] + std * noise[..., 3:6])
    reach = np.vecdot(rows[..., 0, :], c) + std[..., 0] * np.sqrt(np.vecdot(c, c)) * noise[..., 6]
    return (speed / reach)[..., None] * c


@dataclass(frozen=True)
class GaussianForwardModel:
    """Random Jacobian of level ``alpha`` α ≥ 0 under the bound ``u`` > 0 on its Frobenius norm: s = α²(u² − ‖J̲_k‖_F²)/n².

    Eq. (GausMod), a step through its inverse Eq. (RMTInvDiff).
    Where a single pose exceeds the bound, ‖J̲‖_F > u, its noise is zero, and such poses are counted. Only α·sqrt(u² − ‖J̲‖²) matters
    at a pose, and ‖J̲‖_F, which the row of φ dominates, hardly changes from pose to pose.
    """

    alpha: float
    u: float

    def __post_init__(self) -> None:
        if not (0 <= self.alpha < np.inf and 0 < self.u < np.inf):
            raise ModelDomainError("alpha must be finite and not negative, u finite and positive", alpha=self.alpha, u=self.u)

    def require_bound(self, chain: PlanarChain, path: np.ndarray) -> None:
        """Raise ModelDomainError where u is below ‖J̲‖_F on ``path`` (M, 3) in rad: particles may stray there, the motion may not."""
        noise_scale(frobenius(chain.jacobian(path)), self.alpha, self.u, 3)

    def sample(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, int]:
        """One draw of the next joint angles (..., 3) for each of ``q``: Algorithm 2 in law; the number of poses beyond u.

        At rest (v = 0) exactly ``q``, beyond u exactly the nominal step.
        """
        nominal = np.matvec(chain.inverse_jacobian(q), v)
        s, clipped = self._variance(chain.jacobian(q))
        drawn = sample_inverse_action(chain.jacobian(q), v, s, rng)
        return q + np.where(s[..., None] > 0, drawn, nominal), clipped

    def law(self) -> Law:
        """:meth:`sample` compiled."""
        from pipeline.motion.compiled import gaussian  # here, as it loads the compiler

        return Law(gaussian.of_forward, np.array([self.alpha, self.u], dtype=float), normals=(1, 7))

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Raises ModelDomainError: it does not exist."""
        raise self._missing("mean")

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Raises ModelDomainError: it does not exist."""
        raise self._missing("covariance")

    def log_density(
        self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray | None = None
    ) -> np.ndarray:
        """(...,) exact without ``measurement`` (:mod:`pipeline.motion.gaussian_forward_density`), by quadrature with it
        (:mod:`pipeline.motion.gaussian_forward_blur`); where there is no noise, N(q + J⁻¹v, ``measurement``).

        Raises ModelDomainError at rest and beyond u without ``measurement``, and where it is not positive definite.
        """
        q, v, q_next = np.broadcast_arrays(q, v, q_next)
        nominal = np.matvec(chain.inverse_jacobian(q), v)
        jacobian, step = chain.jacobian(q), q_next - q
        s, _ = self._variance(jacobian)
        random = np.any(v, axis=-1) & (s > 0)
        if measurement is None:
            if not np.all(random):
                raise ModelDomainError(
                    "a step of the matrix model has no density at rest and beyond the bound u, "
                    f"as at {int(np.count_nonzero(~random))} of {random.size} step(s); give the covariance of the measurement noise"
                )
            flat = action_log_density(step.reshape(-1, 3), v.reshape(-1, 3), jacobian.reshape(-1, 3, 3), s.reshape(-1))
            return flat.reshape(random.shape)
        result = np.array(normal_log_density(step - nominal, 0.0, measurement))
        result[random] = blurred_log_density(step[random], v[random], jacobian[random], s[random], measurement)
        return result

    def _variance(self, jacobian: np.ndarray) -> tuple[np.ndarray, int]:
        norm = frobenius(jacobian)
        return noise_scale(np.minimum(norm, self.u), self.alpha, self.u, 3), int(np.count_nonzero(norm > self.u))

    def _missing(self, moment: str) -> ModelDomainError:
        return ModelDomainError(
            f"the {moment} of a step of the forward Gaussian model does not exist: its Jacobian has density on singular matrices",
            alpha=self.alpha, u=self.u,
        )  # fmt: skip
