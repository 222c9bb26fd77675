"""The optimal perturbation of every step: (BsampOpt) through the one scalar equation λ(s) = λ of
:mod:`.bound`, in bulk.

Where the noise can be explained exactly, as with as many joints as task rows, λ(0) > 0: weights up
to it leave the exact fit, in closed form. Beyond λ(∞) = ‖Aᵀω‖/‖ω‖ it is y = 0. In between is the
root (:mod:`.root`).
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled, inner
from pipeline.models.wishart.bound import (
    ALONG,
    LEFT,
    PULL,
    SPARE,
    Y,
    split,
)
from pipeline.models.wishart.root import root
from pipeline.models.wishart.triangles import factorize, solve

# least share that a pivot of AᵀA has of its entry: below it rounding decides the fit
LEAST_PIVOT = 1e-14
# share of ‖ω‖² below which what A leaves of it is rounding
LEAST_REST = 1e-28
HALF = float(np.sqrt(0.5))
APEX = 1e-9  # share of δ below which X is at its bound, where there is no d


@compiled
def perturb(
    noise: np.ndarray,
    a: np.ndarray,
    back: np.ndarray,
    ratio: float,
    delta: float,
    steps: int,
    s: np.ndarray,
    norms: np.ndarray,
    bound: np.ndarray,
    matrix: np.ndarray,
    squares: np.ndarray,
    room: np.ndarray,
) -> int:
    """Solve N problems; return the number of the first whose equation was not solved in ``steps``
    or whose A is all but singular, −1 where there is none.

    Args:
        noise: (N, n) ω.
        a: (N, m) J₁⁻¹v.
        back: (N, n, m) J₂⁺.
        ratio: λ.
        delta: δ = 1 − ε.
        steps: of Newton's method or halvings, at most.
        s: (N, m, m) written, S; zero before.
        norms: (N, 2) written, ‖ω − Ay‖ and ‖S‖_F; zero before.
        bound: (N,) written, whether the bound holds S back; false before.
        matrix: (n, m + 1) room for A and ω − Ay.
        squares: (3, m, m) room for AᵀA, its factor and that of AᵀA + sI.
        room: (ROWS, m) room.
    """
    n, m = back.shape[1:]
    e, y, pull = room[ALONG], room[Y], room[PULL]
    for number in range(len(noise)):
        omega, size, steepness = noise[number], 0.0, 0.0
        for i in range(n):
            size += omega[i] * omega[i]
        norms[number, 0] = np.sqrt(size)
        if not _begin(omega, a[number], back[number], matrix, squares[0], room):
            continue
        for i in range(m):
            steepness += pull[i] * pull[i]
        if not steepness > ratio * ratio * size:
            continue
        if not factorize(squares[0], 0.0, squares[1]) > LEAST_PIVOT:
            return number
        rest = _nearest(omega, matrix, size, squares[1], room)
        across = rest if n > m and rest > LEAST_REST * size else 0.0
        c, least = _at_zero(delta, across, squares[1], room)
        if (across > 0.0 and ratio > 0.0) or least < ratio:
            most = np.sqrt(steepness / size)
            c = root(ratio, delta, across, least, most, steps, squares, room)
            if not c >= 0.0:
                return number
            rest = _rest(omega, matrix, y)
        norms[number, 0] = np.sqrt(rest)
        norms[number, 1], bound[number] = _write(e, y, c, delta, s[number])
    return -1


@inner
def _begin(
    omega: np.ndarray,
    a: np.ndarray,
    back: np.ndarray,
    matrix: np.ndarray,
    gram: np.ndarray,
    room: np.ndarray,
) -> bool:
    """Write A = J₂⁺W⁻¹, W⁻¹ = r(I/√2 + (1 − 1/√2)eeᵀ), AᵀA, Aᵀω and e; false at rest."""
    e, pull, (n, m) = room[ALONG], room[PULL], back.shape
    square = 0.0
    for j in range(m):
        square += a[j] * a[j]
    if not square > 0:
        return False
    r = np.sqrt(square)
    for j in range(m):
        e[j] = a[j] / r
        pull[j] = 0.0
        for k in range(j + 1):
            gram[j, k] = 0.0
    for i in range(n):
        along = 0.0
        for j in range(m):
            along += back[i, j] * e[j]
        for j in range(m):
            matrix[i, j] = entry = r * (HALF * back[i, j] + (1 - HALF) * along * e[j])
            pull[j] += entry * omega[i]
            for k in range(j + 1):
                gram[j, k] += entry * matrix[i, k]
    return True


@inner
def _rest(omega: np.ndarray, matrix: np.ndarray, y: np.ndarray) -> float:
    """‖ω − Ay‖², and ω − Ay behind the columns of A."""
    (n, m), square = matrix.shape, 0.0
    for i in range(n):
        rest = omega[i]
        for j in range(m - 1):
            rest -= matrix[i, j] * y[j]
        matrix[i, m - 1] = rest
        square += rest * rest
    return square


@inner
def _nearest(
    omega: np.ndarray, matrix: np.ndarray, size: float, exact: np.ndarray, room: np.ndarray
) -> float:
    """‖ω − Ay‖² at the y of least squares, which is written; of ‖ω‖² ``size``.

    AᵀA has the square of the condition of A: where that is felt the fit is taken once more, to what
    the first left.
    """
    y, u, spare = room[Y], room[LEFT], room[SPARE]
    solve(exact, room[PULL], y)
    rest = _rest(omega, matrix, y)
    if rest > LEAST_REST * size:
        for j in range(len(y)):
            u[j] = 0.0
            for i in range(len(omega)):
                u[j] += matrix[i, j] * matrix[i, len(y)]
        solve(exact, u, spare)
        for j in range(len(y)):
            y[j] += spare[j]
        rest = _rest(omega, matrix, y)
    return rest


@inner
def _at_zero(
    delta: float, across: float, exact: np.ndarray, room: np.ndarray
) -> tuple[float, float]:
    """c and λ(0) at s = 0, of y there; λ(0) = 0 where ‖ω⊥‖² ``across`` is left, −1 where y breaks
    the bound whatever c.
    """
    e, y, u = room[ALONG], room[Y], room[LEFT]
    x, beside = split(e, y)
    corner = delta + x
    if not corner > 0.0:
        return 0.0, -1.0
    c = max(0.0, beside / (2 * corner) - delta)
    if across > 0.0:
        return c, 0.0
    for i in range(len(y)):
        u[i] = y[i] - c * e[i]
    length = solve(exact, u, room[SPARE])
    return c, corner * np.sqrt((x * x + beside + c * c) / length) / (corner + c)


@inner
def _write(
    e: np.ndarray, y: np.ndarray, c: float, delta: float, s: np.ndarray
) -> tuple[float, bool]:
    """‖S‖_F, and whether the bound is kept with equality; S of y and c is written.

    S is of the x that d and c leave at the bound, which does not cancel.
    """
    m = len(e)
    x, across = split(e, y)
    along = x
    if c > 0.0:
        along = across / (2 * (delta + c)) - delta
    block = c / across if across > 0.0 else 0.0
    for i in range(m):
        d = y[i] - x * e[i]
        for j in range(i + 1):
            other = y[j] - x * e[j]
            s[i, j] = along * e[i] * e[j] + HALF * (e[i] * other + d * e[j]) + block * d * other
            s[j, i] = s[i, j]
    return np.sqrt(along * along + across + c * c), c > 0.0 or delta + along < APEX * delta
