"""Samples of the perturbation matrix B from the process noise: the convex problem (BsampOpt)–(const10) in closed form, in bulk.

With B⁻¹ = I + S, a = J₁⁻¹v, r = ‖a‖, e = a/r the problem is: minimise α₁‖ω − J₂⁻¹Sa‖ + α₂‖S‖_F over symmetric S with I + S > 0.

1. Among all symmetric S with Sa = s the one of least norm is S = (saᵀ + asᵀ)/r² − (aᵀs)aaᵀ/r⁴, and ‖S‖_F = ‖Ws‖ with
   W = (eeᵀ + √2(I − eeᵀ))/r. In y = Ws what is left is: minimise ‖ω − Ay‖ + λ‖y‖, A = J₂⁻¹W⁻¹, λ = α₂/α₁.
2. Its stationary points are y_μ = (AᵀA + μI)⁻¹Aᵀω with μ = λ‖ω − Ay‖/‖y‖. In the singular values σ_i of A and the coordinates
   c_i of ω along its left singular vectors this says that the mean of σ_i² under the weights c_i²/(σ_i² + μ)² equals λ². The mean
   grows with μ (larger μ favours larger σ_i), so there is one root, found by bisection. Where the mean exceeds λ² already at μ = 0
   the noise is explained exactly (y = A⁻¹ω); where it stays below λ² as μ → ∞, y = 0.
3. S has rank two and the least eigenvalue (s∥ − sqrt(s∥² + 4s⊥²))/2r, with s∥ and s⊥ the parts of s along and across e. Where it
   breaks I + S ⪰ εI the problem is solved anew with that bound (:mod:`pipeline.motion.bound`). B⁻¹ > 0 alone would have no
   minimum there: B would grow without end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.errors import ModelDomainError
from pipeline.motion.bound import solve_bounded
from pipeline.randommatrix.wishart import normalized_std

# halvings of the interval of μ/(μ + scale): beyond the last bit of a double
BISECTIONS = 60


@dataclass(frozen=True)
class Perturbations:
    """Optimal perturbations of N steps."""

    s: np.ndarray  # (N, 3, 3) S = B⁻¹ − I
    objective: np.ndarray  # (N,) F at the optimum
    bound: np.ndarray  # (N,) whether B⁻¹ ⪰ εI held the perturbation back


def objective_weights(rest_noise: float, n: int, factor: float = 1.0) -> tuple[float, float]:
    """(α₁, α₂) of (BsampOpt), α₁ + α₂ = 1, from ``rest_noise``, the root mean square of ‖ω‖ recorded at rest, in rad.

    The paper leaves them open, and the two terms differ in unit (rad and 1). Here a residual of the size of the measurement noise costs
    as much as a perturbation of B⁻¹ by its own norm: α₂/α₁ = rest_noise/‖I_n‖_F; ``factor`` multiplies that ratio. Raises ModelDomainError
    where either is not positive.
    """
    if not 0 < rest_noise < np.inf:
        raise ModelDomainError(
            "the noise recorded at rest must be positive and finite to weigh the perturbation against it", rest_noise=rest_noise
        )
    if not 0 < factor < np.inf:
        raise ModelDomainError("the factor on alpha2/alpha1 must be positive and finite", factor=factor)
    ratio = factor * rest_noise / np.sqrt(n)
    return 1 / (1 + ratio), ratio / (1 + ratio)


def least_norm_perturbation(a: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(..., n, n) the symmetric S of least Frobenius norm with Sa = s, for ``a`` and ``s`` (..., n); ``a`` not zero."""
    squared = np.vecdot(a, a)[..., None, None]
    outer = s[..., :, None] * a[..., None, :]
    along = np.vecdot(a, s)[..., None, None] * a[..., :, None] * a[..., None, :]
    return (outer + np.swapaxes(outer, -1, -2)) / squared - along / squared**2


def least_sum_of_norms(noise: np.ndarray, matrix: np.ndarray, ratio: float) -> np.ndarray:
    """(N, n) argmin over y of ‖ω − Ay‖ + λ‖y‖ for ``noise`` ω (N, n), invertible ``matrix`` A (N, n, n) and ``ratio`` λ ≥ 0: step 2."""
    left, singular, right = np.linalg.svd(matrix)
    c = np.matvec(np.swapaxes(left, -1, -2), noise)
    square = singular**2
    # μ = scale·t/(1 − t): t = 0 is the exact fit, t = 1 is y = 0, and the weights stay finite between
    scale = square[:, :1]
    low, high = np.zeros_like(scale), np.ones_like(scale)

    def beyond(t: np.ndarray) -> np.ndarray:
        weights = (c / ((1 - t) * square + t * scale)) ** 2
        return (weights * (square - ratio**2)).sum(axis=-1, keepdims=True) >= 0

    exact, zero = beyond(low), ~beyond(high)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        above = beyond(middle)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    t = np.where(exact, 0.0, np.where(zero, 1.0, high))
    return np.matvec(np.swapaxes(right, -1, -2), (1 - t) * singular * c / ((1 - t) * square + t * scale))


def fit_perturbations(noise: np.ndarray, a: np.ndarray, back: np.ndarray, weights: tuple[float, float], floor: float) -> Perturbations:
    """Solve (BsampOpt) for N steps, with (const10) in the form B⁻¹ ⪰ εI.

    ``noise`` ω (N, 3) in rad, measured minus nominal; ``a`` = J₁⁻¹v (N, 3) and ``back`` = J₂⁻¹ (N, 3, 3) from
    :func:`pipeline.motion.decomposition.factors`; ``weights`` (α₁, α₂); ``floor`` ε in (0, 1). At rest (a = 0) nothing can be
    explained and S = 0. Raises ModelDomainError for weights or a floor outside their range and for noise that is not finite,
    SolverError where the bounded problem did not reach its optimum.
    """
    alpha1, alpha2 = weights
    if not (alpha1 > 0 and alpha2 >= 0 and 0 < floor < 1):
        raise ModelDomainError("needs alpha1 > 0, alpha2 >= 0 and a floor between 0 and 1", alpha1=alpha1, alpha2=alpha2, floor=floor)
    finite = np.all(np.isfinite(noise), axis=-1)
    if not np.all(finite):
        raise ModelDomainError(
            "the process noise must be finite at every step", index=int(finite.argmin()), not_finite=int((~finite).sum())
        )
    ratio = alpha2 / alpha1
    perturbation = np.zeros(back.shape)
    moving = np.flatnonzero(np.vecdot(a, a) > 0)
    bound = np.zeros(len(noise), dtype=bool)
    if moving.size:
        omega, a_moving = noise[moving], a[moving]
        r = np.sqrt(np.vecdot(a_moving, a_moving))
        e = a_moving / r[:, None]
        along = e[:, :, None] * e[:, None, :]
        unweigh = r[:, None, None] * (along + (np.eye(a.shape[1]) - along) / np.sqrt(2))
        matrix = back[moving] @ unweigh
        y = least_sum_of_norms(omega, matrix, ratio)
        s = np.matvec(unweigh, y)
        perturbation[moving] = least_norm_perturbation(a_moving, s)
        s_along = np.vecdot(e, s)
        least_eigenvalue = (s_along - np.sqrt(np.maximum(4 * np.vecdot(s, s) - 3 * s_along**2, 0.0))) / (2 * r)
        for i in np.flatnonzero(1 + least_eigenvalue < floor):
            perturbation[moving[i]] = solve_bounded(omega[i], e[i], matrix[i], ratio, floor)
            bound[moving[i]] = True
    residual = noise - np.matvec(back, np.matvec(perturbation, a))
    objective = alpha1 * np.linalg.norm(residual, axis=-1) + alpha2 * np.linalg.norm(perturbation, axis=(-1, -2))
    return Perturbations(perturbation, objective, bound)


def dispersions(perturbations: np.ndarray) -> np.ndarray:
    """(M,) σ̂_Bk of each step from ``perturbations`` S (takes, M, n, n) by (NormStd); their mean is the paper's σ̂_B.

    The samples are B = (I + S)⁻¹ and E[B] is the model's, I_n, to which the last term of (BsampOpt) draws them, not a sample mean.
    """
    identity = np.eye(perturbations.shape[-1])
    return normalized_std(np.linalg.inv(identity + perturbations), identity)
