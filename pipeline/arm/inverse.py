"""Compiled steps of the pseudo-inverse J⁺ = Jᵀ(JJᵀ)⁻¹ by JJᵀ = LLᵀ, a block of poses at a time
(:mod:`pipeline.arm.rows`).
"""

import numpy as np

from pipeline.arm.rows import add_dot, dot, fill, scale
from pipeline.core.compiled import inner


@inner
def cholesky(block, jacobian, lower, inverse, m, n, shift, count):
    """Fill L of JJᵀ − ``shift``·I = LLᵀ from row ``lower`` on (m·m) and 1/L_rr from ``inverse`` on;
    NaN if there is no factor. The relative error of J⁺ is at most 1e-10 at a regular pose.
    """
    for r in range(m):
        for s in range(r + 1):
            entry = lower + r * m + s
            dot(block, entry, jacobian + r * n, jacobian + s * n, n, count)
            add_dot(block, entry, -1.0, lower + r * m, lower + s * m, s, count)
            if s < r:
                scale(block, entry, inverse + s, count)
            else:
                for i in range(count):
                    root = np.sqrt(block[entry, i] - shift)
                    block[entry, i] = root
                    block[inverse + r, i] = 1.0 / root


@inner
def mark_singular(block, arm, jacobian, lower, spare, out, count):
    """Set row ``out`` to 1 where a singular value of J is below ``arm.least``, i.e. JJᵀ − least²·I
    has no factor, else to 0, and return True if it is 1 at any pose; m·m + m rows from ``spare`` on
    are scratch. Most blocks need no such factor: (det L)² is at most the least squared singular
    value times the (m − 1)th power of the mean of the other squares.
    """
    m, n, least = len(arm.rows), len(arm.sliding), arm.least
    fill(block, out, 1.0, count)
    fill(block, spare, 0.0, count)
    for r in range(m):
        add_dot(block, spare, 1.0, lower + r * m, lower + r * m, r + 1, count)
    for r in range(m):
        for i in range(count):
            square = block[lower + r * m + r, i] * block[lower + r * m + r, i]
            block[out, i] *= square * ((m - 1) / block[spare, i] if r > 0 else 1.0)
    near = 0
    for i in range(count):
        near += 0 if block[out, i] > 4.0 * least * least else 1  # NaN too
    if near == 0:
        return False
    fill(block, out, 0.0, count)
    cholesky(block, jacobian, spare, spare + m * m, m, n, least * least, count)
    for r in range(m):
        for i in range(count):
            regular = block[spare + r * m + r, i] > 0.0
            block[out, i] = block[out, i] if regular else 1.0
    return True


@inner
def solve_lower(block, lower, inverse, m, x, count):
    """Replace the m rows x by L⁻¹x, with L and 1/L_rr of :func:`cholesky`."""
    for r in range(m):
        add_dot(block, x + r, -1.0, lower + r * m, x, r, count)
        scale(block, x + r, inverse + r, count)


@inner
def solve_upper(block, lower, inverse, m, x, count):
    """Replace the m rows x by L⁻ᵀx."""
    for r in range(m - 1, -1, -1):
        at = lower + (r + 1) * m + r
        add_dot(block, x + r, -1.0, at, x + r + 1, m - r - 1, count, m)
        scale(block, x + r, inverse + r, count)
