"""Samples of the perturbation matrix B from the process noise: the convex problem
(BsampOpt)–(const10), in bulk.

With B⁻¹ = I + S, S (m, m), a = J₁⁻¹v, r = ‖a‖, e = a/r the problem is: minimise α₁‖ω − J₂⁺Sa‖ +
α₂‖S‖_F over symmetric S with I + S > 0.

1. Among all symmetric S with Sa = s the one of least norm is S = (saᵀ + asᵀ)/r² − (aᵀs)aaᵀ/r⁴, and
   ‖S‖_F = ‖Ws‖ with W = (eeᵀ + √2(I − eeᵀ))/r. In y = Ws what is left is: minimise ‖ω − Ay‖ +
   λ‖y‖, A = J₂⁺W⁻¹ (n, m), λ = α₂/α₁. Of more joints than task rows the part of ω across the range
   of J₂⁺ is explained by no S.
2. S has rank two and the least eigenvalue (x − sqrt(x² + 2‖d‖²))/2, with x and d the parts of y
   along and across e. Where it would break I + S ⪰ εI, S has a part across a too. B⁻¹ > 0 alone
   would have no minimum there: B would grow without end.
3. The optimum, held back or not, is the root of one scalar equation whatever m is (:mod:`.bound`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ModelDomainError, SolverError

STEPS = 200  # towards the root, halvings with them; six are usual


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
    rest_noise/‖I_m‖_F. The residual is of all n joints, as the noise is, S of the m task rows.
    ``factor`` multiplies that ratio. Raises ModelDomainError where either is not positive.
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
    ratio = factor * rest_noise / np.sqrt(m)
    return 1 / (1 + ratio), ratio / (1 + ratio)


def fit_perturbations(
    noise: np.ndarray, a: np.ndarray, back: np.ndarray, weights: tuple[float, float], floor: float
) -> Perturbations:
    """Solve (BsampOpt) for N steps, with (const10) in the form B⁻¹ ⪰ εI; where the first term
    vanishes, Eq. (Omegki) holds.

    ``noise`` ω (N, n) in rad, measured minus nominal; ``a`` = J₁⁻¹v (N, m) and ``back`` = J₂⁺ (N,
    n, m) from :func:`.factors.factors`; ``weights`` (α₁, α₂); ``floor`` ε in
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
    from pipeline.models.wishart.bound import ROWS  # here, as they load the compiler
    from pipeline.models.wishart.samples import perturb

    count, n, m = back.shape
    s, norms, bound = np.zeros((count, m, m)), np.zeros((count, 2)), np.zeros(count, dtype=bool)
    inputs = [np.ascontiguousarray(each, dtype=float) for each in (noise, a, back)]
    room = np.empty((n, m + 1)), np.empty((3, m, m)), np.empty((ROWS, m))
    ratio = alpha2 / alpha1
    unsolved = perturb(*inputs, ratio, 1 - floor, STEPS, s, norms, bound, *room)
    if unsolved >= 0:
        raise SolverError(
            "the perturbation of a step was not solved to optimality",
            index=unsolved,
            noise=noise[unsolved].tolist(),
            ratio=ratio,
            floor=floor,
        )
    return Perturbations(s, norms @ (alpha1, alpha2), bound)
