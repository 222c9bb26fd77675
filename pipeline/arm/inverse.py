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
            row = lower + r * m  # of L
            column = lower + s * m  # of Lᵀ
            entry = row + s
            dot(block, entry, jacobian + r * n, jacobian + s * n, n, count)
            add_dot(block, entry, -1.0, row, column, s, count)
            if s < r:
                scale(block, entry, inverse + s, count)
            else:
                for i in range(count):
                    root = np.sqrt(block[entry, i] - shift)
                    block[entry, i] = root
                    block[inverse + r, i] = 1.0 / root


@inner
def mark_singular(block, arm, jacobian, lower, spare, out, count):
    """Set row ``out`` to 1 where a singular value of the scaled Jacobian is below ``arm.least``,
    else to 0, and return True if it is 1 at any pose; m·n + m·m + m rows from ``spare`` on are
    scratch. ``lower`` has the factor L of JJᵀ.
    """
    m = len(arm.rows)
    n = len(arm.sliding)
    least = arm.least
    if not _any_near_singular(block, arm, lower, spare, out, count):
        return False
    scaled = spare + m * m + m
    for r in range(m):
        for j in range(n):
            size = 1.0 / _row_size(arm, r)
            size *= arm.reach if arm.sliding[j] > 0.0 else 1.0
            entry = scaled + r * n + j
            for i in range(count):
                block[entry, i] = size * block[jacobian + r * n + j, i]
    # JJᵀ − least²·I has no factor where a singular value is below the bound
    cholesky(block, scaled, spare, spare + m * m, m, n, least * least, count)
    fill(block, out, 0.0, count)
    for r in range(m):
        for i in range(count):
            regular = block[spare + r * m + r, i] > 0.0
            block[out, i] = block[out, i] if regular else 1.0
    return True


@inner
def _any_near_singular(block, arm, lower, spare, out, count):
    """Return whether any pose may be singular, which is False for most blocks: (det L)² is at most
    the least squared singular value times the (m − 1)th power of the mean of the other squares.
    """
    m = len(arm.rows)
    least = arm.least
    # columns without units may be shorter than those of J
    if np.any(arm.sliding > 0.0):
        least /= min(arm.reach, 1.0)
    fill(block, out, 1.0, count)
    fill(block, spare, 0.0, count)
    for r in range(m):
        row = lower + r * m
        add_dot(block, spare, 1.0 / _row_size(arm, r) ** 2, row, row, r + 1, count)
    for r in range(m):
        weight = 1.0 / _row_size(arm, r) ** 2
        diagonal = lower + r * m + r
        for i in range(count):
            square = weight * block[diagonal, i] * block[diagonal, i]
            block[out, i] *= square * ((m - 1) / block[spare, i] if r > 0 else 1.0)
    bound = 4.0 * least * least
    near = 0
    for i in range(count):
        near += 0 if block[out, i] > bound else 1  # NaN too
    return near > 0


@inner
def _row_size(arm, r):
    """Return the reach for a row of velocity, the length for an angular row."""
    return arm.reach if arm.rows[r] < 3 else arm.units[r]


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
