"""Samples of the perturbation matrix B from the process noise: the convex problem
(BsampOpt)–(const10) in closed form, in bulk.

With B⁻¹ = I + S, a = J₁⁻¹v, r = ‖a‖, e = a/r the problem is: minimise α₁‖ω − J₂⁻¹Sa‖ + α₂‖S‖_F over
symmetric S with I + S > 0.

1. Among all symmetric S with Sa = s the one of least norm is S = (saᵀ + asᵀ)/r² − (aᵀs)aaᵀ/r⁴, and
‖S‖_F = ‖Ws‖ with
   W = (eeᵀ + √2(I − eeᵀ))/r. In y = Ws what is left is: minimise ‖ω − Ay‖ + λ‖y‖, A = J₂⁻¹W⁻¹, λ =
   α₂/α₁.
2. Its stationary points are y = Aᵀp, p = (AAᵀ + μI)⁻¹ω, μ > 0, where ω − Ay = μp: so μ is where
‖Aᵀp‖ = λ‖p‖. The length of p does not
   matter there, and up to its length p is a polynomial in μ, adj(AAᵀ + μI)ω = adj(A)ᵀadj(A)ω +
   μ(tr(AAᵀ)I − AAᵀ)ω + μ²ω: what is sought
   is the root of a quartic, and no singular values are needed. ‖Aᵀp‖²/‖p‖² is a mean of the squared
   singular values of A whose weights
   move to the larger ones as μ grows, so there is one root. Where the mean exceeds λ² already at μ
   = 0 the noise is explained
   exactly (y = A⁻¹ω); where it stays below λ² as μ → ∞, y = 0.
3. S has rank two and the least eigenvalue (x − sqrt(x² + 2‖d‖²))/2, with x and d the parts of y
along and across e. Where it
   breaks I + S ⪰ εI the problem is solved anew with that bound (:mod:`.bound`). B⁻¹
   > 0 alone would have no
   minimum there: B would grow without end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.wishart.bound import solve_bounded
from pipeline.randommatrix.wishart import normalized_std

# eight are usual; in so many halvings t would be known to the last bit, however small
ROOT_STEPS = 100
SETTLED = 1e-9  # last step, as a share of t: Newton's next would be of the size of its square


@dataclass(frozen=True)
class Perturbations:
    """Optimal perturbations of N steps."""

    s: np.ndarray  # (N, 3, 3) S = B⁻¹ − I
    objective: np.ndarray  # (N,) F at the optimum
    bound: np.ndarray  # (N,) whether B⁻¹ ⪰ εI held the perturbation back


def objective_weights(rest_noise: float, n: int, factor: float = 1.0) -> tuple[float, float]:
    """(α₁, α₂) of (BsampOpt), α₁ + α₂ = 1, from ``rest_noise``, the root mean square of ‖ω‖
    recorded at rest, in rad.

    The paper leaves them open, and the two terms differ in unit (rad and 1). Here a residual of the
    size of the measurement noise costs as much as a perturbation of B⁻¹ by its own norm: α₂/α₁ =
    rest_noise/‖I_n‖_F; ``factor`` multiplies that ratio. Raises ModelDomainError where either is
    not positive.
    """
    if not 0 < rest_noise < np.inf:
        raise ModelDomainError(
            "the noise recorded at rest must be positive and finite to weigh the perturbation "
            "against it",
            rest_noise=rest_noise,
        )
    if not 0 < factor < np.inf:
        raise ModelDomainError(
            "the factor on alpha2/alpha1 must be positive and finite", factor=factor
        )
    ratio = factor * rest_noise / np.sqrt(n)
    return 1 / (1 + ratio), ratio / (1 + ratio)


def least_norm_perturbation(e: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(..., n, n) the symmetric S of least Frobenius norm with WSa = y, for the directions ``e`` of
    a and ``y`` (..., n): step 1.
    """
    along = np.vecdot(e, y)[..., None] * e
    f = along / 2 + (y - along) / np.sqrt(2)
    outer = e[..., :, None] * f[..., None, :]
    return outer + np.swapaxes(outer, -1, -2)


def least_sum_of_norms(noise: np.ndarray, matrix: np.ndarray, ratio: float) -> np.ndarray:
    """(N, 3) argmin over y of ‖ω − Ay‖ + λ‖y‖ for ``noise`` ω (N, 3), regular ``matrix`` A (N, 3,
    3) and ``ratio`` λ ≥ 0: step 2.
    """
    pull = np.vecmat(noise, matrix)
    result = np.zeros(noise.shape)
    moved = np.flatnonzero(np.vecdot(pull, pull) >= ratio**2 * np.vecdot(noise, noise))
    # the batch last, so that each entry is contiguous over it: several times as fast for matrices
    # this small
    omega, pull, a = (
        np.ascontiguousarray(np.moveaxis(each[moved], 0, -1)) for each in (noise, pull, matrix)
    )

    def turned(rows: int, columns: int) -> np.ndarray:
        return np.roll(a, (-rows, -columns), axis=(0, 1))

    cofactors = turned(1, 1) * turned(2, 2) - turned(1, 2) * turned(2, 1)
    determinant = (a[0] * cofactors[0]).sum(axis=0)
    trace, minors = ((each**2).sum(axis=(0, 1)) for each in (a, cofactors))
    # p = Σ_i p_i μⁱ and Aᵀp, the coefficients stacked
    adjugate_of_noise = np.einsum("ijn,in->jn", cofactors, omega)
    p = np.stack(
        [
            np.einsum("ijn,jn->in", cofactors, adjugate_of_noise),
            trace * omega - np.einsum("ijn,jn->in", a, pull),
            omega,
        ]
    )
    image = np.stack([determinant * adjugate_of_noise, np.einsum("ijn,in->jn", a, p[1]), pull])
    products = np.einsum("kin,lin->kln", image, image) - ratio**2 * np.einsum("kin,lin->kln", p, p)
    # the anti-diagonals of the products are the coefficients of the quartic ‖Aᵀp‖² − λ²‖p‖²
    mu = _root(
        [
            products[0, 0],
            2 * products[0, 1],
            products[1, 1] + 2 * products[0, 2],
            2 * products[1, 2],
            products[2, 2],
        ],
        trace,
    )
    y = (image[0] + mu * (image[1] + mu * image[2])) / (
        determinant**2 + mu * (minors + mu * (trace + mu))
    )
    result[moved] = y.T
    return result


def _root(quartic: list[np.ndarray], scale: np.ndarray) -> np.ndarray:
    """(N,) the only root μ of Σ_i k_i μⁱ over μ ≥ 0 for ``quartic`` k, five (N,) with k₄ ≥ 0, and 0
    where k₀ ≥ 0; ``scale`` (N,) that of μ.

    Newton's steps in t of μ = scale·t/(1 − t), t in [0, 1), and halvings where they would leave
    what the signs have not ruled out.
    """
    inside = np.flatnonzero(quartic[0] < 0)
    unit = scale[inside]
    k0, k1, k2, k3, k4 = (k[inside] * unit**i for i, k in enumerate(quartic))
    low, high, t = (
        np.zeros(len(inside)),
        np.full(len(inside), 1 - np.finfo(float).eps),
        np.full(len(inside), 0.5),
    )
    for _ in range(ROOT_STEPS):
        u = 1 - t
        # Horner's rule in both of t and u
        value = k4 * t + k3 * u
        slope = 4 * k4 * t + k3 * (3 * u - t)
        square = u * u
        value, slope = value * t + k2 * square, slope * t + 2 * k2 * u * (u - t)
        value, slope = value * t + k1 * square * u, slope * t + k1 * square * (u - 3 * t)
        value, slope = value * t + k0 * square * square, slope - 4 * k0 * square * u
        low, high = np.where(value < 0, t, low), np.where(value < 0, high, t)
        with np.errstate(divide="ignore", invalid="ignore"):
            following = t - value / slope
        following = np.where((low <= following) & (following <= high), following, (low + high) / 2)
        settled, t = np.all(np.abs(following - t) <= SETTLED * t), following
        if settled:
            break
    mu = np.zeros(len(scale))
    mu[inside] = unit * t / (1 - t)
    return mu


def fit_perturbations(
    noise: np.ndarray, a: np.ndarray, back: np.ndarray, weights: tuple[float, float], floor: float
) -> Perturbations:
    """Solve (BsampOpt) for N steps, with (const10) in the form B⁻¹ ⪰ εI; where the first term
    vanishes, Eq. (Omegki) holds.

    ``noise`` ω (N, 3) in rad, measured minus nominal; ``a`` = J₁⁻¹v (N, 3) and ``back`` = J₂⁻¹ (N,
    3, 3) from :func:`.factors.factors`; ``weights`` (α₁, α₂); ``floor`` ε in
    (0, 1). At rest (a = 0) nothing can be explained and S = 0. Raises ModelDomainError for weights
    or a floor outside their range and for noise that is not finite, SolverError where the bounded
    problem did not reach its optimum.
    """
    alpha1, alpha2 = weights
    if not (alpha1 > 0 and alpha2 >= 0 and 0 < floor < 1):
        raise ModelDomainError(
            "needs alpha1 > 0, alpha2 >= 0 and a floor between 0 and 1",
            alpha1=alpha1,
            alpha2=alpha2,
            floor=floor,
        )
    finite = np.all(np.isfinite(noise), axis=-1)
    if not np.all(finite):
        raise ModelDomainError(
            "the process noise must be finite at every step",
            index=int(finite.argmin()),
            not_finite=int((~finite).sum()),
        )
    ratio = alpha2 / alpha1
    perturbation, bound = np.zeros(back.shape), np.zeros(len(noise), dtype=bool)
    moving = np.flatnonzero(np.vecdot(a, a) > 0)
    omega, a_moving, back_moving = noise[moving], a[moving], back[moving]
    r = np.sqrt(np.vecdot(a_moving, a_moving))[:, None]
    e = a_moving / r
    # A = J₂⁻¹W⁻¹ with W⁻¹ = r(I/√2 + (1 − 1/√2)eeᵀ)
    matrix = (r / np.sqrt(2))[:, None] * back_moving + (
        (1 - np.sqrt(0.5)) * r * np.matvec(back_moving, e)
    )[:, :, None] * e[:, None, :]
    y = least_sum_of_norms(omega, matrix, ratio)
    free = least_norm_perturbation(e, y)
    along = np.vecdot(e, y)
    least_eigenvalue = (along - np.sqrt(np.maximum(2 * np.vecdot(y, y) - along**2, 0.0))) / 2
    broken = np.flatnonzero(1 + least_eigenvalue < floor)
    if broken.size:
        free[broken] = solve_bounded(
            omega[broken], a_moving[broken], matrix[broken], y[broken], ratio, floor
        )
    perturbation[moving], bound[moving[broken]] = free, True
    residual = noise - np.matvec(back, np.matvec(perturbation, a))
    objective = alpha1 * np.sqrt(np.vecdot(residual, residual)) + alpha2 * np.sqrt(
        (perturbation**2).sum(axis=(1, 2))
    )
    return Perturbations(perturbation, objective, bound)


def dispersions(perturbations: np.ndarray) -> np.ndarray:
    """(M,) σ̂_Bk of each step from ``perturbations`` S (takes, M, n, n) by (NormStd); their mean is
    the paper's σ̂_B.

    The samples are B = (I + S)⁻¹ and E[B] is the model's, I_n, to which the last term of (BsampOpt)
    draws them, not a sample mean.
    """
    identity = np.eye(perturbations.shape[-1])
    return normalized_std(np.linalg.inv(identity + perturbations), identity)
