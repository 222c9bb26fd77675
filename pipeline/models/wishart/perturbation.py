"""Samples of the perturbation matrix B from the process noise: the convex problem
(BsampOpt)–(const10), in bulk.

With B⁻¹ = I + S, S (m, m), a = J₁⁻¹v, r = ‖a‖, e = a/r the problem is: minimise α₁‖ω − J₂⁺Sa‖ +
α₂‖S‖_F over symmetric S with I + S > 0. Among all symmetric S with Sa = s the one of least norm is
S = (saᵀ + asᵀ)/r² − (aᵀs)aaᵀ/r⁴, and ‖S‖_F = ‖Ws‖ with W = (eeᵀ + √2(I − eeᵀ))/r. In y = Ws what
is left is: minimise ‖ω − Ay‖ + λ‖y‖, A = J₂⁺W⁻¹ (n, m), λ = α₂/α₁. With n > m the part of ω across
the range of J₂⁺ is explained by no S. Where that S would break I + S ⪰ εI, it has a part across a
too; B⁻¹ > 0 alone would have no minimum there, as B would grow without end. The optimum is the root
of one scalar equation for any m (:mod:`.samples`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ModelDomainError, SolverError

STEPS = 300  # places tried on the way to a root
LEAST_REST = 1e-28  # share of ‖ω‖² below which the part of ω across the range of A is rounding
HALF = float(np.sqrt(0.5))
APEX = 1e-9  # share of δ below which δ + x is at its bound, where there is no d


@dataclass(frozen=True)
class Perturbations:
    """Optimal perturbations of N steps."""

    s: np.ndarray  # (N, m, m) S = B⁻¹ − I
    objective: np.ndarray  # (N,) F at the optimum
    bound: np.ndarray  # (N,) whether B⁻¹ ⪰ εI held the perturbation back


def objective_weights(rest_noise: float, m: int, factor: float = 1.0) -> tuple[float, float]:
    """(α₁, α₂) of (BsampOpt), α₁ + α₂ = 1, for B (m, m), from ``rest_noise``, the root mean square
    of ‖ω‖ recorded at rest, in rad.

    The paper leaves them open, and the two terms differ in unit (rad and 1). Here a residual of the
    size of the measurement noise costs as much as a perturbation of B⁻¹ by its own norm: α₂/α₁ =
    ``factor``·rest_noise/‖I_m‖_F. Raises ModelDomainError where either is not positive.
    """
    if not (0 < rest_noise < np.inf and 0 < factor < np.inf):
        raise ModelDomainError(
            "the weights of a perturbation need noise recorded at rest, and a factor on "
            "alpha2/alpha1, that are positive and finite",
            rest_noise=rest_noise,
            factor=factor,
        )
    ratio = factor * rest_noise / np.sqrt(m)
    return 1 / (1 + ratio), ratio / (1 + ratio)


def fit_perturbations(
    noise: np.ndarray, a: np.ndarray, back: np.ndarray, weights: tuple[float, float], floor: float
) -> Perturbations:
    """Solve (BsampOpt) for N steps, with (const10) in the form B⁻¹ ⪰ εI; where the first term
    vanishes, Eq. (Omegki) holds.

    ``noise`` ω (N, n) in rad, measured minus nominal; ``a`` J₁⁻¹v (N, m) and ``back`` J₂⁺ (N, n, m)
    of :func:`.decomposition.factors`; ``weights`` (α₁, α₂); ``floor`` ε in (0, 1). At rest (a = 0)
    S = 0. Raises ModelDomainError for weights or a floor outside their range and for noise that is
    not finite, SolverError where the optimum was not reached or J₂ is all but singular.
    """
    from pipeline.models.wishart.samples import perturb  # here, as it loads the compiler

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
    (count, n, m), ratio, delta = back.shape, alpha2 / alpha1, 1 - floor
    r = np.sqrt(np.vecdot(a, a))[:, None]
    e = a / np.where(r > 0, r, 1.0)
    along = np.matvec(back, e)[..., None] * e[:, None]
    matrix = r[..., None] * (HALF * back + (1 - HALF) * along)
    gram, pull = np.swapaxes(matrix, 1, 2) @ matrix, np.vecmat(noise, matrix)
    size, rest = np.vecdot(noise, noise), np.zeros(count)
    if n > m:
        axes = np.linalg.qr(back)[0]
        across = noise - np.matvec(axes, np.vecmat(noise, axes))
        rest = np.vecdot(across, across)
        rest[rest < LEAST_REST * size] = 0.0
    y, c, buffers = np.zeros((count, m)), np.zeros(count), (np.empty((3, m, m)), np.empty((3, m)))
    unsolved = perturb(gram, pull, e, size, rest, ratio, delta, STEPS, y, c, *buffers)
    if unsolved >= 0:
        raise SolverError(
            "the perturbation of a step was not solved to optimality",
            index=unsolved,
            noise=noise[unsolved].tolist(),
            ratio=ratio,
            floor=floor,
        )
    x = np.vecdot(e, y)
    d = y - x[:, None] * e
    across = np.vecdot(d, d)
    # at the bound x follows from d and c, which does not cancel
    x = np.where(c > 0, across / (2 * (delta + c)) - delta, x)
    block = np.divide(c, across, out=np.zeros(count), where=across > 0)
    beside = HALF * e[:, :, None] * d[:, None]
    s = x[:, None, None] * e[:, :, None] * e[:, None] + block[:, None, None] * (
        d[:, :, None] * d[:, None]
    )
    s += beside + np.swapaxes(beside, 1, 2)
    left = noise - np.matvec(matrix, y)
    norms = np.sqrt(np.vecdot(left, left)), np.sqrt(x * x + across + c * c)
    bound = (c > 0) | (delta + x < APEX * delta)
    return Perturbations(s, alpha1 * norms[0] + alpha2 * norms[1], bound)
