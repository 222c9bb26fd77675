"""Optimal perturbations in bulk, in compiled code: the place on one curve that belongs to a weight.

With the notation of :mod:`.perturbation`, δ = 1 − ε, write S in a frame whose first axis is e: x
in its corner, d/√2 beside it, a block C across e, y = xe + d. S ⪰ −δI means X = δ + x > 0 and
C ⪰ ddᵀ/2X − δI (Schur). One eigenvalue of that matrix can be positive, so the C of least norm is
c·ddᵀ/‖d‖² with c ≥ 0 and ‖d‖² ≤ 2X(δ + c), an equality where c > 0. The minimum of ‖ω − Ay‖ +
λ‖(y, c)‖ under that is stationary where, for some s > 0,

    (AᵀA + sI)y = Aᵀω + s·c·e,   λ(s) = X·‖(y, c)‖·s / ((X + c)·‖ω − Ay‖),

so y = y₀ + c·g, and the equality is quadratic in c with one positive root where y₀ breaks the
bound. F is convex, so λ(s) grows with s: from the closest fit at s = 0 to y = 0 at s = ∞. Nothing
cancels in ‖ω − Ay‖² = s²·uᵀ(AᵀA)⁻¹u + ‖ω⊥‖², u = y − ce, ω⊥ the part of ω across the range of A.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled, inner

LEAST_PIVOT = 1e-14  # share of a pivot of AᵀA in its entry: below it rounding decides the fit
ENDS = 1e-24, 1e24  # of s, as shares of the trace of AᵀA
LEAST = 1e-20  # of λ(s)/λ: below it values are alike
SETTLED = 1e-12  # of ln λ, and of ln s between the ends of a bracket


@inner
def factorize(matrix: np.ndarray, ridge: float, factor: np.ndarray) -> float:
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
def solve(factor: np.ndarray, side: np.ndarray, solution: np.ndarray) -> float:
    """Write M⁻¹b into ``solution`` (m,) for ``side`` b and the ``factor`` of M; return bᵀM⁻¹b."""
    m, square = len(side), 0.0
    for i in range(m):
        entry = side[i]
        for j in range(i):
            entry -= factor[i, j] * solution[j]
        solution[i] = entry
    for i in range(m):
        scaled = solution[i] * factor[i, i]
        square += solution[i] * scaled
        solution[i] = scaled
    for i in range(m - 1, -1, -1):
        entry = solution[i]
        for j in range(i + 1, m):
            entry -= factor[j, i] * solution[j]
        solution[i] = entry
    return square


@inner
def place(
    s: float,
    delta: float,
    rest: float,
    squares: np.ndarray,
    e: np.ndarray,
    pull: np.ndarray,
    y: np.ndarray,
    buffer: np.ndarray,
) -> tuple[float, float]:
    """c and λ(s) at ``s`` > 0; y (m,) is written.

    ``rest`` is ‖ω⊥‖², ``squares`` (3, m, m) AᵀA, its factor and a buffer, ``pull`` (m,) Aᵀω,
    ``buffer`` (3, m).
    """
    m, (g, u, spare) = len(e), buffer
    factorize(squares[0], s, squares[2])
    solve(squares[2], pull, y)
    solve(squares[2], e, g)
    x = along = 0.0
    for i in range(m):
        g[i] *= s
        x += e[i] * y[i]
        along += e[i] * g[i]
    # ‖d‖² − 2X(δ + c) = −bend·c² + 2·tilt·c + broken
    broken, tilt, bend = -2 * delta * (delta + x), -delta * along - (delta + x), 2 * along
    for i in range(m):
        d, turn = y[i] - x * e[i], g[i] - along * e[i]
        broken += d * d
        tilt += d * turn
        bend -= turn * turn
    c = 0.0
    if broken > 0:
        root = np.sqrt(tilt * tilt + bend * broken)
        c = (tilt + root) / bend if tilt > 0 else broken / (root - tilt)
    x += c * along
    size, corner, across = c * c, delta + x, 0.0
    for i in range(m):
        y[i] += c * g[i]
        u[i] = y[i] - c * e[i]
        size += y[i] * y[i]
        d = y[i] - x * e[i]
        across += d * d
    if c > 0:
        corner = across / (2 * (delta + c))  # which does not cancel
    left = s * s * solve(squares[1], u, spare) + rest
    return c, corner * np.sqrt(size / left) * s / (corner + c)


@compiled
def perturb(
    gram: np.ndarray,
    pull: np.ndarray,
    e: np.ndarray,
    size: np.ndarray,
    rest: np.ndarray,
    ratio: float,
    delta: float,
    steps: int,
    y: np.ndarray,
    c: np.ndarray,
    squares: np.ndarray,
    buffer: np.ndarray,
) -> int:
    """Solve N problems for the weight ``ratio`` λ and ``delta`` δ; return the number of the first
    whose AᵀA is all but singular or whose λ(s) is not λ after ``steps`` places, −1 for none.

    ``gram`` AᵀA (N, m, m), ``pull`` Aᵀω and ``e`` (N, m), ``size`` ‖ω‖² and ``rest`` ‖ω⊥‖² (N,);
    ``y`` (N, m) and ``c`` (N,), zero before, are written; ``squares`` (3, m, m) and ``buffer``
    (3, m) are buffers.
    """
    m = gram.shape[1]
    for number in range(len(gram)):
        steepness = trace = 0.0
        for i in range(m):
            steepness += pull[number, i] ** 2
            trace += gram[number, i, i]
            for j in range(m):
                squares[0, i, j] = gram[number, i, j]
        if not steepness > ratio * ratio * size[number]:  # y = 0
            continue
        if not factorize(squares[0], 0.0, squares[1]) > LEAST_PIVOT:
            return number
        case = squares, e[number], pull[number], y[number], buffer
        # a bracket (low, high) of the root of f = ln λ(s)/λ in ln s, from the closest fit on
        low, high = np.log(ENDS[0] * trace), np.log(ENDS[1] * trace)
        corner, weight = place(np.exp(low), delta, rest[number], *case)
        c[number] = corner
        if weight >= ratio:
            continue
        below = above = 0.0
        t, stride, kept = np.log(1e-2 * trace), 2.0, 0
        for step in range(steps + 1):
            if step == steps:
                return number
            corner, weight = place(np.exp(t), delta, rest[number], *case)
            # where X is at its bound λ(s) may jump from zero
            f = np.log(max(weight, LEAST * ratio) / ratio)
            c[number] = corner
            if abs(f) <= SETTLED or high - low <= SETTLED:
                break
            # Illinois: an end that stays twice has its value halved
            if f > 0:
                high, above, below = t, f, below / 2 if kept == 1 else below
                kept = 1
            else:
                low, below, above = t, f, above / 2 if kept == -1 else above
                kept = -1
            if below < 0 < above:
                t = high - above * (high - low) / (above - below)
                if step % 4 == 3:  # a bend or a jump
                    t = (low + high) / 2
            else:
                t += -stride if f > 0 else stride
                stride *= 2
                if not low < t < high:
                    t = (low + high) / 2
    return -1
