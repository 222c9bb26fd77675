"""J = LQ for compiled code, a block of poses at a time, in a room of
:mod:`pipeline.arm.serial_compiled`.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inlined, inner


@inner
def orthonormalise(
    room: np.ndarray, jacobian: int, lower: int, spare: int, m: int, n: int, count: int
) -> None:
    """J = LQ of the first ``count`` poses: Q, m orthonormal rows, takes the place of J, and L,
    lower triangular of positive diagonal, is put into the rows from ``lower`` on.

    Modified Gram–Schmidt, each row once: down to a least singular value of a thousandth of the
    greatest QQᵀ is I, and QᵀL⁻¹ is J⁺, to 1e-12 of their size. Above the diagonal L's rows stay as
    they are.

    Args:
        room: the block.
        jacobian: the first of the m·n rows of J, row by row.
        lower: the first of the m·m rows of L, row by row; they need not be those of
            :func:`lower_at`.
        spare: a row that is overwritten.
        m: rows of J.
        n: columns of J.
        count: how many poses.
    """
    over = room[spare]
    for r in range(m):
        own, length = jacobian + r * n, room[lower + r * m + r]
        for s in range(r):
            other, component = jacobian + s * n, room[lower + r * m + s]
            _product(room, own, other, n, component, count)
            for j in range(n):
                _add(room[own + j], -1.0, component, room[other + j], count)
        _product(room, own, own, n, length, count)
        for i in range(count):
            length[i] = np.sqrt(length[i])
            over[i] = 1 / length[i]
        for j in range(n):
            entry = room[own + j]
            for i in range(count):
                entry[i] *= over[i]


@inlined
def _product(room: np.ndarray, one: int, other: int, n: int, out: np.ndarray, count: int) -> None:
    """Fill ``out`` with the scalar products of the ``n`` rows of ``room`` from ``one`` on and of
    those from ``other`` on.
    """
    for i in range(count):
        out[i] = 0.0
    for j in range(n):
        _add(out, 1.0, room[one + j], room[other + j], count)


@inlined
def _add(out: np.ndarray, sign: float, one: np.ndarray, other: np.ndarray, count: int) -> None:
    """Add to the row ``out`` the products of the rows ``one`` and ``other`` with ``sign``."""
    for i in range(count):
        out[i] += sign * one[i] * other[i]


@inner
def too_singular(
    room: np.ndarray, lower: int, spare: int, m: int, least: float, out: int, count: int
) -> None:
    """Put 1 into row ``out`` of ``room`` where the least singular value of L (m, m), in the rows
    from ``lower`` on, is below ``least`` or no number, else 0.

    LLᵀ − least²·I has as many negative pivots as L has singular values below ``least`` (Sylvester's
    law of inertia): no eigenvalue is needed. Blocks far from singular are not asked for it.

    Args:
        room: the block.
        lower: the first of the rows of L, row by row.
        spare: the first of m·m rows that are overwritten.
        m: rows of L.
        least: the bound, in L's unit.
        out: the row of the result.
        count: how many poses.
    """
    singular = room[out]
    if _far_from_singular(room, lower, spare, m, least, singular, count):
        for i in range(count):
            singular[i] = 0.0
        return
    for r in range(m):
        for s in range(r + 1):
            entry = room[spare + r * m + s]
            _product(room, lower + r * m, lower + s * m, s + 1, entry, count)
        for i in range(count):
            entry[i] -= least * least
    for i in range(count):
        singular[i] = 0.0
    for k in range(m):
        pivot = room[spare + k * m + k]
        for i in range(count):
            singular[i] = singular[i] if pivot[i] > 0.0 else 1.0
            pivot[i] = 1 / pivot[i]
        for r in range(k + 1, m):
            below, multiple = room[spare + r * m + k], room[spare + k * m + r]
            for i in range(count):
                multiple[i] = below[i] * pivot[i]
            for s in range(k + 1, r + 1):
                _add(room[spare + r * m + s], -1.0, multiple, room[spare + s * m + k], count)


@inlined
def _far_from_singular(
    room: np.ndarray,
    lower: int,
    spare: int,
    m: int,
    least: float,
    bound: np.ndarray,
    count: int,
) -> bool:
    """Whether a bound keeps the least singular value of every L above twice ``least``.

    Its square is (det L)² over the product of the others, which is at most the (m − 1)th power of
    their mean, (‖L‖²/(m − 1))^{m−1}. The rows ``bound`` and ``spare`` are overwritten.
    """
    over, near = room[spare], 0
    for i in range(count):
        over[i] = 0.0
        bound[i] = 1.0
    for r in range(m):
        for s in range(r + 1):
            _add(over, 1.0, room[lower + r * m + s], room[lower + r * m + s], count)
    for i in range(count):
        over[i] = (m - 1) / over[i]
    for r in range(m):
        diagonal = room[lower + r * m + r]
        for i in range(count):
            bound[i] *= diagonal[i] * diagonal[i] * (over[i] if r > 0 else 1.0)
    for i in range(count):
        near += 0 if bound[i] > 4 * least * least else 1  # NaN too
    return near == 0


@inner
def invert(room: np.ndarray, jacobian: int, lower: int, m: int, n: int, count: int) -> None:
    """Make of Q of J = LQ (:func:`orthonormalise`, of these arguments) L⁻ᵀQ, the transpose of J⁺ =
    QᵀL⁻¹.
    """
    for r in range(m - 1, -1, -1):
        length = room[lower + r * m + r]
        for j in range(n):
            entry = room[jacobian + r * n + j]
            for i in range(count):
                entry[i] /= length[i]
        for s in range(r):
            component = room[lower + r * m + s]
            for j in range(n):
                solved = room[jacobian + r * n + j]
                _add(room[jacobian + s * n + j], -1.0, component, solved, count)
