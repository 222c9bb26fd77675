"""Equations in four rows by minors (Laplace's expansion over two columns and two), for compiled
code: scalars alone and no pivots, so that loops around them take several poses at once.

Exact to rounding times the ratio of the products of the columns' lengths to the determinant: the
caller keeps that in bounds.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inlined


@inlined
def dot(x: tuple, y: tuple) -> float:
    """The scalar product of four numbers and four."""
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2] + x[3] * y[3]


@inlined
def pairs(x: tuple, y: tuple) -> tuple[float, ...]:
    """The minors of [x, y] in rows 01, 02, 03, 12, 13 and 23."""
    return (
        x[0] * y[1] - x[1] * y[0],
        x[0] * y[2] - x[2] * y[0],
        x[0] * y[3] - x[3] * y[0],
        x[1] * y[2] - x[2] * y[1],
        x[1] * y[3] - x[3] * y[1],
        x[2] * y[3] - x[3] * y[2],
    )


@inlined
def determinant(p: tuple, q: tuple) -> float:
    """Of [a, b, c, d] with the :func:`pairs` ``p`` of a and b, ``q`` of c and d."""
    ends = p[0] * q[5] + p[5] * q[0]
    return ends - (p[1] * q[4] + p[4] * q[1]) + (p[2] * q[3] + p[3] * q[2])


@inlined
def across(x: tuple, p: tuple) -> tuple[float, ...]:
    """What has with any y the scalar product det[y, x, a, b], the :func:`pairs` of a and b being
    ``p``.
    """
    return (
        x[1] * p[5] - x[2] * p[4] + x[3] * p[3],
        x[2] * p[2] - x[0] * p[5] - x[3] * p[1],
        x[0] * p[4] - x[1] * p[2] + x[3] * p[0],
        x[1] * p[1] - x[0] * p[3] - x[2] * p[0],
    )


@inlined
def solved(a: tuple, b: tuple, c: tuple, d: tuple, y: tuple) -> tuple[tuple[float, ...], float]:
    """x of [a, b, c, d]x = y, and the determinant."""
    first, last = pairs(a, b), pairs(c, d)
    det = determinant(first, last)
    over = 1 / det
    one, other = across(y, last), across(y, first)
    x = -dot(b, one) * over, dot(a, one) * over, -dot(d, other) * over, dot(c, other) * over
    return x, det


@inlined
def null(a: tuple, b: tuple, c: tuple, d: tuple, e: tuple) -> tuple[float, ...]:
    """x of [a, b, c, d, e]x = 0, as long as the product of the singular values."""
    first, last = pairs(a, b), pairs(d, e)
    rest = across(c, last)
    return (
        dot(b, rest),
        -dot(a, rest),
        determinant(first, last),
        -determinant(first, pairs(c, e)),
        determinant(first, pairs(c, d)),
    )


@inlined
def mirror(x: tuple) -> tuple[float, ...]:
    """t of the Householder reflection of the five numbers ``x`` to the last axis: its vector is
    (t, 1). No entry is greater than 1.
    """
    length = np.sqrt(dot(x, x) + x[4] * x[4])
    over = 1 / (x[4] + np.copysign(length, x[4]))
    return x[0] * over, x[1] * over, x[2] * over, x[3] * over


@inlined
def without(x: tuple, share: float, y: tuple) -> tuple[float, ...]:
    """The four numbers ``x`` − ``share``·``y``."""
    return (
        x[0] - share * y[0],
        x[1] - share * y[1],
        x[2] - share * y[2],
        x[3] - share * y[3],
    )
