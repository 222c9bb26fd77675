"""The perturbations under B⁻¹ ⪰ εI: the optimum of (BsampOpt) as a place on one curve, for any m.

With the notation of :mod:`.perturbation` and δ = 1 − ε write S in a frame whose first axis is e: x
in its corner, d/√2 beside it and a block C across e, so that y = xe + d. S ⪰ −δI means δ + x > 0
and C ⪰ ddᵀ/2(δ + x) − δI (Schur). Of that matrix one eigenvalue alone can be positive: so the C of
least norm, its positive part, is c·ddᵀ/‖d‖², c ≥ 0 and, with X = δ + x,

    ‖d‖² ≤ 2X(δ + c),

with equality where c > 0. What is left is convex: minimise ‖ω − Ay‖ + λ‖(y, c)‖ under that. With μ
= λ‖ω − Ay‖/‖(y, c)‖ and a multiplier μc/X its stationary points have, in s = μ(X + c)/X,

    (AᵀA + sI)y = Aᵀω + s·c·e.

So y = y₀ + c·g with y₀ = (AᵀA + sI)⁻¹Aᵀω, the free optimum of another weight, and g = s(AᵀA +
sI)⁻¹e. With them the equality is a quadratic equation of c. It has one root c > 0 where y₀ breaks
the bound, and none where y₀ keeps it: there c = 0. So each s > 0 is the optimum of one weight,

    λ(s) = X·‖(y, c)‖·s / ((X + c)·‖ω − Ay‖),

which grows with s, as F is convex: from the fit as exact as can be at s = 0 to y = 0 at s = ∞.
Nothing cancels in ‖ω − Ay‖² = s²·uᵀ(AᵀA)⁻¹u + ‖ω⊥‖², u = y − ce, ω⊥ what ω has across the range
of A.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inner
from pipeline.models.wishart.triangles import factorize, solve

# rows of the room (ROWS, m) of a problem
ALONG, PULL, Y, RAISED, LEFT, SPARE = range(6)
ROWS = 6


@inner
def split(e: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """x and ‖d‖² of ``y`` (m,)."""
    x = across = 0.0
    for i in range(len(e)):
        x += e[i] * y[i]
    for i in range(len(e)):
        d = y[i] - x * e[i]
        across += d * d
    return x, across


@inner
def place(
    s: float,
    delta: float,
    rest: float,
    squares: np.ndarray,
    room: np.ndarray,
) -> tuple[float, float, float]:
    """c at s > 0, λ(s) and its slope; y is written into ``room``.

    Args:
        s: the place.
        delta: δ.
        rest: ‖ω⊥‖².
        squares: (3, m, m) AᵀA and its factor; that of AᵀA + sI is written.
        room: (ROWS, m) e and Aᵀω at ALONG and PULL; y is written at Y, the others are room.
    """
    e, y, g, u, spare = room[ALONG], room[Y], room[RAISED], room[LEFT], room[SPARE]
    m, factor = len(e), squares[2]
    factorize(squares[0], s, factor)
    solve(factor, room[PULL], y)
    solve(factor, e, g)
    x = along = 0.0
    for i in range(m):
        g[i] *= s
        x += e[i] * y[i]
        along += e[i] * g[i]
    # of ‖d‖² − 2X(δ + c) = −bend·c² + 2·tilt·c + broken
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
    solve(factor, u, spare)
    c_slope = 0.0
    if c > 0:
        over, under = 0.0, -(delta + c) * along - corner
        for i in range(m):
            d = y[i] - x * e[i]
            over += (d - (delta + c) * e[i]) * spare[i]
            under += d * g[i]
        c_slope = over / under
    x_slope, size_slope, left_slope = 0.0, c * c_slope, 0.0
    for i in range(m):
        y_slope = c_slope * g[i] - spare[i]
        x_slope += e[i] * y_slope
        size_slope += y[i] * y_slope
        left_slope += u[i] * y_slope
    weight = corner * np.sqrt(size / left) * s / (corner + c)
    change = 1 / s + size_slope / size + s * left_slope / left
    change += x_slope / corner - (x_slope + c_slope) / (corner + c)
    return c, weight, weight * change
