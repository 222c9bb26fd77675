"""Samples of the perturbation matrix B from the process noise: the convex problem
(BsampOpt)–(const10), in bulk and in compiled code.

With B⁻¹ = I + S, S (m, m), a = J₁⁻¹v, r = ‖a‖, e = a/r the problem is: minimise α₁‖ω − J₂⁺Sa‖ +
α₂‖S‖_F over symmetric S with I + S > 0. The S of least norm with Sa = s is (saᵀ + asᵀ)/r² −
(aᵀs)aaᵀ/r⁴, of norm ‖y‖, y = (eeᵀ + √2(I − eeᵀ))s/r. What is left is: minimise ‖ω − Ay‖ + λ‖y‖,
λ = α₂/α₁. Where I + S ⪰ εI binds, δ = 1 − ε, S also has a part across a: with y = xe + d,
X = δ + x > 0, it is c·ddᵀ/‖d‖², c ≥ 0, and ‖d‖² ≤ 2X(δ + c) (Schur), an equality where c > 0.
The minimum of ‖ω − Ay‖ + λ‖(y, c)‖ is stationary where, for some s > 0,

    (AᵀA + sI)y = Aᵀω + s·c·e,   λ(s) = X·‖(y, c)‖·s / ((X + c)·‖ω − Ay‖).

The equality is quadratic in c, and λ(s) grows with s, as F is convex: from the closest fit at s = 0
to y = 0 at s = ∞. Nothing cancels in ‖ω − Ay‖² = s²·uᵀ(AᵀA)⁻¹u + ‖ω⊥‖², u = y − ce, ω⊥ the part
of ω across the range of A.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.core.compiled import compiled, inner
from pipeline.core.errors import ModelDomainError, SolverError

STEPS = 300  # places tried on the way to a root
LEAST_PIVOT = 1e-14  # share of a pivot of AᵀA in its entry: below it rounding decides the fit
LEAST_REST = 1e-28  # share of ‖ω‖² below which the part of ω across the range of A is rounding
ENDS = 1e-24, 1e24  # of s, as shares of the trace of AᵀA
LEAST = 1e-20  # of λ(s)/λ: below it values are alike
SETTLED = 1e-12  # of ln λ, and of ln s between the ends of a bracket
HALF = float(np.sqrt(0.5))
APEX = 1e-9  # share of δ below which δ + x is at its bound, where there is no d


class Perturbations(NamedTuple):
    """Optimal perturbations of N steps."""

    s: ndarray  # (N, m, m) S = B⁻¹ − I
    objective: ndarray  # (N,) F at the optimum
    bound: ndarray  # (N,) True where B⁻¹ ⪰ εI held the perturbation back


def objective_weights(rest_noise: float, m: int, factor: float = 1.0) -> tuple[float, float]:
    """(α₁, α₂) of (BsampOpt), which the paper leaves open, α₁ + α₂ = 1, for B (m, m): a residual of
    ``rest_noise``, rms ‖ω‖ at rest in rad, costs as much as a perturbation of B⁻¹ by its own norm,
    α₂/α₁ = ``factor``·rest_noise/‖I_m‖_F. Raises ModelDomainError where either is not positive.
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
    noise: ndarray, a: ndarray, back: ndarray, weights: tuple[float, float], floor: float
) -> Perturbations:
    """Solve (BsampOpt) for N steps, with (const10) in the form B⁻¹ ⪰ εI, ε the ``floor``; where the
    first term vanishes, Eq. (Omegki) holds.

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
    inputs = (np.array(each, order="C") for each in (noise, a, back))
    unsolved, s, norms, bound = perturb(*inputs, ratio, 1 - floor, STEPS)
    if unsolved >= 0:
        raise SolverError(
            "the perturbation of a step was not solved to optimality",
            index=unsolved,
            noise=noise[unsolved].tolist(),
            ratio=ratio,
            floor=floor,
        )
    return Perturbations(s, norms @ np.array(weights), bound)


# rows of the buffer of one problem: Aᵀω, e, y, what y moves by with c, y − ce, and two more
PULL, E, Y, MOVED, U, SPARE, D = range(7)


@inner
def _dot(x: ndarray, p: int, y: ndarray, q: int) -> float:
    """Product of row ``p`` of ``x`` and row ``q`` of ``y``; views of rows would take longer."""
    total = 0.0
    for i in range(x.shape[1]):
        total += x[p, i] * y[q, i]
    return total


@inner
def factorize(matrix: ndarray, ridge: float, factor: ndarray) -> float:
    """Write L and D of ``matrix`` + ``ridge``·I = LDLᵀ into ``factor`` (m, m): L below the
    diagonal, 1/D on it, (LD)ᵀ above; return the least share of a pivot in its diagonal entry.
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
    m, square = len(factor), 0.0
    for i in range(m):
        entry = case[side, i]
        for j in range(i):
            entry -= factor[i, j] * case[solution, j]
        case[solution, i] = entry
    for i in range(m):
        scaled = case[solution, i] * factor[i, i]
        square, case[solution, i] = square + case[solution, i] * scaled, scaled
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            case[solution, i] -= factor[j, i] * case[solution, j]
    return square


@inner
def place(
    s: float, delta: float, rest: float, gram: ndarray, factors: ndarray, case: ndarray
) -> tuple[float, float, float]:
    """c, λ(s) and ‖ω − Ay‖ at ``s`` > 0; y is written. ``rest`` is the square of ω across A,
    ``factors`` that of AᵀA ``gram`` and one more.
    """
    m, shifted = len(gram), factors[1]
    factorize(gram, s, shifted)
    _solve(shifted, case, PULL, Y)
    _solve(shifted, case, E, MOVED)
    for i in range(m):
        case[MOVED, i] *= s
    x, along = _dot(case, E, case, Y), _dot(case, E, case, MOVED)
    # ‖d‖² − 2X(δ + c) = −bend·c² + 2·tilt·c + broken, d = y − xe, moving by g − along·e a c
    broken, tilt, bend = -2 * delta * (delta + x), -delta * along - (delta + x), 2 * along
    for i in range(m):
        d, turn = case[Y, i] - x * case[E, i], case[MOVED, i] - along * case[E, i]
        broken, tilt, bend = broken + d * d, tilt + d * turn, bend - turn * turn
    c = 0.0
    if broken > 0:
        root = np.sqrt(tilt * tilt + bend * broken)
        c = (tilt + root) / bend if tilt > 0 else broken / (root - tilt)
    x, size, across = x + c * along, c * c, 0.0
    for i in range(m):
        y = case[Y, i] = case[Y, i] + c * case[MOVED, i]
        d, case[U, i] = y - x * case[E, i], y - c * case[E, i]
        size, across = size + y * y, across + d * d
    left = np.sqrt(s * s * _solve(factors[0], case, U, SPARE) + rest)
    corner = across / (2 * (delta + c)) if c > 0 else delta + x  # which does not cancel
    return c, corner * np.sqrt(size) / left * s / (corner + c), left


@compiled
def perturb(
    noise: ndarray, a: ndarray, back: ndarray, ratio: float, delta: float, steps: int
) -> tuple[int, ndarray, ndarray, ndarray]:
    """Solve N problems of ``noise`` ω (N, n), ``a`` (N, m), ``back`` (N, n, m), λ and δ: the number
    of the first whose A is all but singular or whose λ(s) is not λ after ``steps`` places, −1 for
    none; S (N, m, m), ‖ω − Ay‖ and ‖S‖_F (N, 2), and the bound (N,).
    """
    count, n, m = back.shape
    s, norms, bound = np.zeros((count, m, m)), np.zeros((count, 2)), np.zeros(count, np.bool_)
    columns, gram, factors = np.empty((m, n)), np.empty((m, m)), np.empty((2, m, m))
    case = np.empty((7, m))
    for k in range(count):
        r, size = np.sqrt(_dot(a, k, a, k)), _dot(noise, k, noise, k)
        norms[k, 0], steepness, trace, rest = np.sqrt(size), 0.0, 0.0, 0.0
        if not r > 0:
            continue
        for j in range(m):
            case[E, j] = a[k, j] / r
        for i in range(n):
            along = 0.0
            for j in range(m):
                along += back[k, i, j] * case[E, j]
            for j in range(m):
                columns[j, i] = r * (HALF * back[k, i, j] + (1 - HALF) * along * case[E, j])
        for j in range(m):
            case[PULL, j] = _dot(columns, j, noise, k)
            for i in range(j + 1):
                gram[j, i] = _dot(columns, j, columns, i)
            trace += gram[j, j]
            steepness += case[PULL, j] ** 2
        if not steepness > ratio * ratio * size:  # y = 0
            continue
        if not factorize(gram, 0.0, factors[0]) > LEAST_PIVOT:
            return k, s, norms, bound
        _solve(factors[0], case, PULL, Y)
        for i in range(n if n > m else 0):
            across = noise[k, i]
            for j in range(m):
                across -= case[Y, j] * columns[j, i]
            rest += across * across
        rest = rest if rest > LEAST_REST * size else 0.0
        c, norms[k, 0], solved = _root(ratio, delta, rest, trace, steps, gram, factors, case)
        if not solved:
            return k, s, norms, bound
        norms[k, 1], bound[k] = _write(case, c, delta, k, s)
    return -1, s, norms, bound


@inner
def _root(ratio, delta, rest, trace, steps, gram, factors, case) -> tuple[float, float, bool]:
    """c and ‖ω − Ay‖ where λ(s) is ``ratio``, and True where it is within ``steps`` places.

    By the Illinois rule on f = ln λ(s)/λ in t = ln s: an end that stays twice has its value halved.
    """
    low, high = np.log(ENDS[0] * trace), np.log(ENDS[1] * trace)
    c, weight, left = place(np.exp(low), delta, rest, gram, factors, case)
    if weight >= ratio:  # the closest fit
        return c, left, True
    t, stride, kept, below, above = np.log(1e-2 * trace), 2.0, 0, 0.0, 0.0
    for step in range(steps):
        c, weight, left = place(np.exp(t), delta, rest, gram, factors, case)
        # where X is at its bound λ(s) may jump from zero
        f = np.log(max(weight, LEAST * ratio) / ratio)
        if abs(f) <= SETTLED or high - low <= SETTLED:
            return c, left, True
        side = 1 if f > 0 else -1
        if f > 0:
            high, above, below = t, f, below / 2 if kept == side else below
        else:
            low, below, above = t, f, above / 2 if kept == side else above
        kept = side
        if not below < 0 < above:
            t, stride = t - side * stride, 2 * stride
        if below < 0 < above and step % 4 != 3:  # else a bend or a jump
            t = high - above * (high - low) / (above - below)
        elif below < 0 < above or not low < t < high:
            t = (low + high) / 2
    return c, left, False


@inner
def _write(case: ndarray, c: float, delta: float, k: int, s: ndarray) -> tuple[float, bool]:
    """Write S of y and c; return its norm, and True where the bound holds it back."""
    m, x = case.shape[1], _dot(case, E, case, Y)
    for i in range(m):
        case[D, i] = case[Y, i] - x * case[E, i]
    across = _dot(case, D, case, D)
    if c > 0:
        x = across / (2 * (delta + c)) - delta  # which does not cancel
    block = c / across if across > 0 else 0.0
    for i in range(m):
        e, d = case[E, i], case[D, i]
        for j in range(m):
            beside = HALF * (e * case[D, j] + d * case[E, j])
            s[k, i, j] = x * e * case[E, j] + beside + block * d * case[D, j]
    return np.sqrt(x * x + across + c * c), c > 0 or delta + x < APEX * delta
