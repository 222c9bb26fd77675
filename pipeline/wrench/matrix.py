"""The random-matrix wrench model: W = S·T with a matrix-variate normal static Jacobian
S ~ N(S̲, Σ_S ⊗ Ψ_S) and an independent normal actuation T ~ N(T̲, Σ_T).

Wrenches alone do not determine Ψ_S: it enters their covariance by the trace tr{(Σ_T + T̲T̲ᵀ)Ψ_S}
only, times Σ_S. Recorded S determine both but for a factor, and so do wrenches at several known T.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.wrench.parametric import CableSystem, wrench_covariance

FORMS = ("diagonal", "full")  # of Σ_S, see optimal_sigma_s


@dataclass(frozen=True)
class MatrixModel:
    """The model without Σ_S, for one system or an array of them: n rows of the wrench, m actuators.
    Rows of moments are in N·m, or in N where a characteristic length divides them.
    """

    jacobian: ndarray  # S̲ (..., n, m)
    actuation: ndarray  # T̲ (..., m), N
    actuation_cov: ndarray  # Σ_T (..., m, m), N²
    psi: ndarray  # Ψ_S (..., m, m)

    def sigma_s_factor(self) -> ndarray:
        """tr{(Σ_T + T̲T̲ᵀ)Ψ_S} = E[TᵀΨ_ST] in N², (...): the factor of Σ_S in Cov(W), Theorem 5 in
        Eq. (TorqCovRHS1), with E[TTᵀ] = Σ_T + T̲T̲ᵀ of Eq. (MeanOfDynParTrns).
        """
        noise = np.einsum("...ij,...ji->...", self.actuation_cov, self.psi)
        return noise + np.einsum("...i,...ij,...j->...", self.actuation, self.psi, self.actuation)

    def actuation_part(self) -> ndarray:
        """S̲Σ_TS̲ᵀ, (..., n, n): the covariance that the actuation alone causes."""
        return self.jacobian @ self.actuation_cov @ np.swapaxes(self.jacobian, -1, -2)

    def mean(self) -> ndarray:
        """E[W] = S̲T̲, (..., n)."""
        return np.einsum("...nm,...m->...n", self.jacobian, self.actuation)

    def covariance(self, sigma_s: ndarray) -> ndarray:
        """Cov(W) = tr{(Σ_T + T̲T̲ᵀ)Ψ_S}·Σ_S + S̲Σ_TS̲ᵀ, (..., n, n): Eqs. (TorqCov)–(CovWNonPar);
        ``sigma_s`` Σ_S (..., n, n).
        """
        return self.sigma_s_factor()[..., None, None] * sigma_s + self.actuation_part()


def matrix_model(system: CableSystem) -> MatrixModel:
    """The model of a cable system, as in the paper with S̲ at e̲, not at E[S] = A(κ)·S̲, and Ψ_S =
    I, as the directions are independent; :func:`moment_fit` estimates Ψ_S.
    """
    identity = np.eye(system.tension.shape[-1])
    covariance = system.tension_sd[..., None] ** 2 * identity
    return MatrixModel(system.jacobian(), system.tension, covariance, identity)


def unbounded_sigma_s(system: CableSystem) -> ndarray:
    """M = (Cov(F) − S̲Σ_TS̲ᵀ)/tr{(Σ_T + T̲T̲ᵀ)Ψ_S}, (..., n, n): the Σ_S with which the models of a
    cable system have equal covariances. Eigenvalues may be negative, as S̲Σ_TS̲ᵀ overstates the
    variance that the tensions cause along a cable.
    """
    model, covariance = matrix_model(system), wrench_covariance(system)
    return (covariance - model.actuation_part()) / model.sigma_s_factor()[..., None, None]


def optimal_sigma_s(unbounded: ndarray, form: str) -> tuple[ndarray, ndarray]:
    """Return the optimal Σ_S ≥ 0 (..., n, n), and the number of its eigenvalues that the bound sets
    to 0 (...); ``unbounded`` M (..., n, n).

    ``form`` "diagonal" is Eq. (SigSOptim), ‖diag Cov(W) − Var(F)‖ = c·‖diag Σ_S − diag M‖, c =
    tr{(Σ_T + T̲T̲ᵀ)Ψ_S}: each entry is max(0, Mᵢᵢ). "full" is the paper's modification, ‖Cov(W) −
    Cov(F)‖_F = c·‖Σ_S − M‖_F: the projection of M on the cone of positive semidefinite matrices,
    negative eigenvalues become 0 (Higham 1988). Where the bound is active, "full" depends on the
    characteristic length.
    """
    target = unbounded if form == "full" else unbounded * np.eye(unbounded.shape[-1])
    values, vectors = np.linalg.eigh(target)
    clipped = np.sum(values < 0, axis=-1)
    projected = (vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return np.where(clipped[..., None, None] > 0, projected, target), clipped


def sample_wrenches(
    model: MatrixModel, sigma_s: ndarray, samples: int, rng: np.random.Generator
) -> ndarray:
    """Draw ``samples`` independent wrenches W = S·T, Eq. (wrench), of one system, (samples, n), by
    S·T given T: N(S̲T, (TᵀΨ_ST)·Σ_S); ``sigma_s`` Σ_S (n, n), positive semidefinite.
    """
    normal = rng.multivariate_normal
    actuation = normal(model.actuation, model.actuation_cov, samples, method="eigh")
    noise = normal(np.zeros(len(sigma_s)), sigma_s, samples, method="eigh")
    scale = np.sqrt(np.einsum("ki,ij,kj->k", actuation, model.psi, actuation))
    return actuation @ model.jacobian.T + scale[:, None] * noise


class KroneckerFit(NamedTuple):
    """S ~ N(mean, Σ_S ⊗ Ψ_S) with tr Ψ_S = m."""

    mean: ndarray  # (n, m)
    sigma_s: ndarray  # Σ_S (n, n), per cable
    psi: ndarray  # Ψ_S (m, m)


def moment_fit(jacobians: ndarray) -> KroneckerFit:
    """Fit the law of recorded ``jacobians`` (N, n, m), rows of one unit, by E[XXᵀ] = tr(Ψ_S)·Σ_S
    and E[XᵀX] = tr(Σ_S)·Ψ_S, X = S − E[S] (Theorem 5).
    """
    mean, m = jacobians.mean(axis=0), jacobians.shape[-1]
    x = jacobians - mean
    covariance = np.einsum("kia,kjb->iajb", x, x) / len(x)
    psi = np.einsum("iaib->ab", covariance)
    return KroneckerFit(mean, np.einsum("iaja->ij", covariance) / m, psi * m / np.trace(psi))
