"""Samples of the perturbation matrix B from the process noise: compiled solution of the convex
problem (BsampOpt)–(const10) for many steps.

With B⁻¹ = I + S, S (m, m), a = J₁⁻¹v, r = ‖a‖, e = a/r the problem is: minimise α₁‖ω − J₂⁺Sa‖ +
α₂‖S‖_F over symmetric S with I + S > 0. The S of least norm with Sa = s is (saᵀ + asᵀ)/r² −
(aᵀs)aaᵀ/r⁴, of norm ‖y‖, y = (eeᵀ + √2(I − eeᵀ))s/r. The problem becomes: minimise ‖ω − Ay‖ + λ‖y‖,
λ = α₂/α₁. If the constraint I + S ⪰ εI is active, S also has a part orthogonal to a. With δ = 1 −
ε, y = xe + d and X = δ + x > 0, this part is c·ddᵀ/‖d‖², c ≥ 0, and ‖d‖² ≤ 2X(δ + c) (Schur), with
equality for c > 0. The minimum of ‖ω − Ay‖ + λ‖(y, c)‖ is stationary where, for some s > 0,

    (AᵀA + sI)y = Aᵀω + s·c·e,   λ(s) = X·‖(y, c)‖·s / ((X + c)·‖ω − Ay‖).

The equality is quadratic in c. λ(s) increases with s, because F is convex, from the closest fit at
s = 0 to y = 0 at s = ∞. No cancellation occurs in ‖ω − Ay‖² = s²·uᵀ(AᵀA)⁻¹u + ‖ω⊥‖², u = y − ce, ω⊥
the part of ω orthogonal to the range of A.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.core.compiled import compiled, inner
from pipeline.core.errors import ModelDomainError, SolverError

STEPS = 300  # greatest number of values of s tried for a root
# pivot of AᵀA divided by its diagonal entry; below it A is singular
LEAST_PIVOT = 1e-14
LEAST_REST = 1e-28  # ‖ω⊥‖²/‖ω‖² below which ω⊥ is rounding
ENDS = 1e-24, 1e24  # of s/tr AᵀA
LEAST = 1e-20  # least value used of λ(s)/λ
SETTLED = 1e-12  # tolerance of ln λ, and of ln s over a bracket
HALF = float(np.sqrt(0.5))
APEX = 1e-9  # (δ + x)/δ below which δ + x is at its bound and d = 0


class Perturbations(NamedTuple):
    """Optimal perturbations of N steps."""

    s: ndarray  # (N, m, m) S = B⁻¹ − I
    objective: ndarray  # (N,) F at the optimum
    bound: ndarray  # (N,) True where the constraint B⁻¹ ⪰ εI is active


def objective_weights(rest_noise: float, m: int) -> tuple[float, float]:
    """Return (α₁, α₂) of (BsampOpt), α₁ + α₂ = 1, for B (m, m); the paper does not state them. A
    residual of ``rest_noise`` (rms ‖ω‖ at rest in rad) costs as much as a perturbation of norm
    ‖I_m‖_F: α₂/α₁ = rest_noise/‖I_m‖_F. ModelDomainError if it is not positive.
    """
    if not 0 < rest_noise < np.inf:
        message = "the noise at rest must be positive and finite"
        raise ModelDomainError(message, rest_noise=rest_noise)
    ratio = rest_noise / np.sqrt(m)
    return 1 / (1 + ratio), ratio / (1 + ratio)


def fit_perturbations(
    noise: ndarray,
    a: ndarray,
    back: ndarray,
    weights: tuple[float, float],
    floor: float,
) -> Perturbations:
    """Solve (BsampOpt) for N steps, with (const10) as B⁻¹ ⪰ εI for ``floor`` ε. Eq. (Omegki) is
    satisfied where the first term vanishes.

    ``noise`` ω (N, n) in rad, measured minus nominal; ``a`` J₁⁻¹v (N, m), zero at rest, where S =
    0, and ``back`` J₂⁺ (N, n, m); ``weights`` (α₁, α₂). Raises ModelDomainError for noise that is
    not finite, SolverError without an optimum.
    """
    finite = np.all(np.isfinite(noise), axis=-1)
    if not np.all(finite):
        raise ModelDomainError(
            "the process noise must be finite at every step",
            index=int(finite.argmin()),
            not_finite=int((~finite).sum()),
        )
    ratio = weights[1] / weights[0]
    delta = 1 - floor
    r = np.sqrt(np.vecdot(a, a))
    size = np.vecdot(noise, noise)
    e = a / np.where(r > 0, r, 1.0)[:, None]
    matrix = HALF * back + (1 - HALF) * _outer(np.matvec(back, e), e)
    matrix *= r[:, None, None]
    pull = np.vecmat(noise, matrix)
    # y = 0 at every other step
    k = np.flatnonzero(np.vecdot(pull, pull) > ratio**2 * size)
    e = e[k]
    matrix = matrix[k]
    rest = np.zeros(len(k))
    if back.shape[1] > a.shape[1]:
        rest = _rest_across(noise[k], matrix)
        rest *= rest > LEAST_REST * size[k]
    gram = np.swapaxes(matrix, 1, 2) @ matrix

    left = np.sqrt(size)
    y, c, left[k], solved = find_optima(pull[k], e, gram, rest, ratio, delta, STEPS)
    if not solved.all():
        index = int(k[solved.argmin()])
        raise SolverError(
            "the perturbation of a step was not solved to optimality",
            index=index,
            noise=noise[index].tolist(),
            ratio=ratio,
            floor=floor,
        )
    x = np.vecdot(e, y)
    d = y - x[:, None] * e
    across = np.vecdot(d, d)
    x = np.where(c > 0, across / (2 * (delta + c)) - delta, x)  # no cancellation
    block = c / np.where(across > 0, across, 1.0)
    beside = HALF * (_outer(e, d) + _outer(d, e))

    s = np.zeros((*a.shape, a.shape[-1]))
    norms = np.zeros(len(a))
    bound = np.zeros(len(a), bool)
    s[k] = _outer(x[:, None] * e, e) + beside + _outer(block[:, None] * d, d)
    norms[k] = np.sqrt(x * x + across + c * c)
    bound[k] = (c > 0) | (delta + x < APEX * delta)
    return Perturbations(s, weights[0] * left + weights[1] * norms, bound)


def _rest_across(noise: ndarray, matrix: ndarray) -> ndarray:
    """(N,) ‖ω⊥‖² of the part of ``noise`` ω (N, n) orthogonal to the range of A, ``matrix``."""
    within, _ = np.linalg.qr(matrix)
    across = noise - np.matvec(within, np.vecmat(noise, within))
    return np.vecdot(across, across)


def _outer(x: ndarray, y: ndarray) -> ndarray:
    return x[:, :, None] * y[:, None, :]


# rows of the buffer of one problem: Aᵀω, e, y, ∂y/∂c, y − ce, scratch
PULL, E, Y, MOVED, U, SPARE = range(6)


@inner
def _dot(x: ndarray, p: int, y: ndarray, q: int) -> float:
    """Dot product of row ``p`` of ``x`` and row ``q`` of ``y``; views of rows would take longer."""
    total = 0.0
    for i in range(x.shape[1]):
        total += x[p, i] * y[q, i]
    return total


@inner
def factorize(matrix: ndarray, ridge: float, factor: ndarray) -> float:
    """Write L and D of ``matrix`` + ``ridge``·I = LDLᵀ into ``factor`` (m, m): L below the
    diagonal, 1/D on it, (LD)ᵀ above; return the least ratio of a pivot to its diagonal entry.
    """
    share = 1.0
    for i in range(len(matrix)):
        pivot = entire = matrix[i, i] + ridge
        for j in range(i):
            entry = matrix[i, j]
            for k in range(j):
                entry -= factor[k, i] * factor[j, k]
            factor[j, i] = entry
        for j in range(i):
            factor[i, j] = factor[j, i] * factor[j, j]
            pivot -= factor[j, i] * factor[i, j]
        factor[i, i] = 1 / pivot
        share = min(share, pivot / entire)
    return share


@inner
def _solve(factor: ndarray, case: ndarray, side: int, solution: int) -> float:
    """Write M⁻¹b, b row ``side``, M by its ``factor``, into row ``solution``; return bᵀM⁻¹b."""
    m = len(factor)
    square = 0.0
    for i in range(m):
        entry = case[side, i]
        for j in range(i):
            entry -= factor[i, j] * case[solution, j]
        case[solution, i] = entry
    for i in range(m):
        scaled = case[solution, i] * factor[i, i]
        square += case[solution, i] * scaled
        case[solution, i] = scaled
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            case[solution, i] -= factor[j, i] * case[solution, j]
    return square


@inner
def place(
    s: float,
    delta: float,
    rest: float,
    gram: ndarray,
    factors: ndarray,
    case: ndarray,
) -> tuple[float, float, float]:
    """Return c, λ(s) and ‖ω − Ay‖ at ``s`` > 0, and write y into ``case``. ``rest`` is ‖ω⊥‖²;
    ``factors`` contains the factor of ``gram`` AᵀA, and scratch.
    """
    m = len(gram)
    shifted = factors[1]
    factorize(gram, s, shifted)
    _solve(shifted, case, PULL, Y)
    _solve(shifted, case, E, MOVED)
    for i in range(m):
        case[MOVED, i] *= s
    x = _dot(case, E, case, Y)
    along = _dot(case, E, case, MOVED)
    # ‖d‖² − 2X(δ + c) = −bend·c² + 2·tilt·c + broken, d = y − xe, moving by g − along·e a c
    broken = -2 * delta * (delta + x)
    tilt = -delta * along - (delta + x)
    bend = 2 * along
    for i in range(m):
        d = case[Y, i] - x * case[E, i]
        turn = case[MOVED, i] - along * case[E, i]
        broken += d * d
        tilt += d * turn
        bend -= turn * turn
    c = 0.0
    if broken > 0:
        root = np.sqrt(tilt * tilt + bend * broken)
        c = (tilt + root) / bend if tilt > 0 else broken / (root - tilt)
    x += c * along
    size = c * c
    across = 0.0
    for i in range(m):
        y = case[Y, i] = case[Y, i] + c * case[MOVED, i]
        d = y - x * case[E, i]
        case[U, i] = y - c * case[E, i]
        size += y * y
        across += d * d
    left = np.sqrt(s * s * _solve(factors[0], case, U, SPARE) + rest)
    corner = across / (2 * (delta + c)) if c > 0 else delta + x  # which does not cancel
    return c, corner * np.sqrt(size) / left * s / (corner + c), left


@compiled
def find_optima(
    pull: ndarray,
    e: ndarray,
    gram: ndarray,
    rest: ndarray,
    ratio: float,
    delta: float,
    steps: int,
) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """Return y (N, m), c (N,) and ‖ω − Ay‖ (N,) of N problems, and flags (N,), False if A is nearly
    singular or the search for λ(s) = λ fails in ``steps`` iterations; ``pull`` is Aᵀω (N, m), ``e``
    (N, m), ``gram`` AᵀA (N, m, m), ``rest`` ‖ω⊥‖² (N,).
    """
    count, m = pull.shape
    y = np.zeros((count, m))
    c = np.zeros(count)
    left = np.zeros(count)
    solved = np.zeros(count) > 0
    factors = np.empty((2, m, m))
    case = np.empty((6, m))
    for k in range(count):
        trace = 0.0
        for j in range(m):
            case[PULL, j], case[E, j] = pull[k, j], e[k, j]
            trace += gram[k, j, j]
        if factorize(gram[k], 0.0, factors[0]) > LEAST_PIVOT:
            root = _root(ratio, delta, rest[k], trace, steps, gram[k], factors, case)
            c[k], left[k], solved[k] = root
            for j in range(m):
                y[k, j] = case[Y, j]
    return y, c, left, solved


@inner
def _root(
    ratio,
    delta,
    rest,
    trace,
    steps,
    gram,
    factors,
    case,
) -> tuple[float, float, bool]:
    """Return c and ‖ω − Ay‖ at λ(s) = ``ratio``, and True if found in ``steps`` iterations.

    Illinois rule on f = ln λ(s)/λ in t = ln s: the value at an end that is kept twice is halved.
    """
    low = np.log(ENDS[0] * trace)
    high = np.log(ENDS[1] * trace)
    c, weight, left = place(np.exp(low), delta, rest, gram, factors, case)
    if weight >= ratio:  # closest fit
        return c, left, True
    t = np.log(1e-2 * trace)
    stride = 2.0
    last_side = 0
    below = 0.0
    above = 0.0
    for step in range(steps):
        c, weight, left = place(np.exp(t), delta, rest, gram, factors, case)
        # at the bound of X, λ(s) may jump from zero
        f = np.log(max(weight, LEAST * ratio) / ratio)
        if abs(f) <= SETTLED or high - low <= SETTLED:
            return c, left, True
        side = 1 if f > 0 else -1
        if f > 0:
            high = t
            above = f
            below = below / 2 if last_side == side else below
        else:
            low = t
            below = f
            above = above / 2 if last_side == side else above
        last_side = side
        if not below < 0 < above:
            t = t - side * stride
            stride = 2 * stride
        if below < 0 < above and step % 4 != 3:  # else a bend or a jump
            t = high - above * (high - low) / (above - below)
        elif below < 0 < above or not low < t < high:
            t = (low + high) / 2
    return c, left, False
