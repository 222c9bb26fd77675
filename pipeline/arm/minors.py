"""Equations in four rows by minors (Laplace's expansion over two columns and two), for compiled
code: scalars alone and no pivots, so that loops around them take several poses at once.

Exact to rounding over the product of the two least singular values, as shares of the greatest.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inlined
from pipeline.core.elementary import fma


@inlined
def dot(x: tuple, y: tuple) -> float:
    """The scalar product of four numbers and four."""
    return fma(x[0], y[0], fma(x[1], y[1], fma(x[2], y[2], x[3] * y[3])))


@inlined
def pairs(x: tuple, y: tuple) -> tuple[float, ...]:
    """The minors of [x, y] in rows 01, 02, 03, 12, 13 and 23."""
    return (
        fma(x[0], y[1], -x[1] * y[0]),
        fma(x[0], y[2], -x[2] * y[0]),
        fma(x[0], y[3], -x[3] * y[0]),
        fma(x[1], y[2], -x[2] * y[1]),
        fma(x[1], y[3], -x[3] * y[1]),
        fma(x[2], y[3], -x[3] * y[2]),
    )


@inlined
def determinant(p: tuple, q: tuple) -> float:
    """Of [a, b, c, d] with the :func:`pairs` ``p`` of a and b, ``q`` of c and d."""
    plus = fma(p[0], q[5], fma(p[5], q[0], fma(p[2], q[3], p[3] * q[2])))
    return plus - fma(p[1], q[4], p[4] * q[1])


@inlined
def across(x: tuple, p: tuple) -> tuple[float, ...]:
    """What has with any y the scalar product det[y, x, a, b], the :func:`pairs` of a and b being
    ``p``.
    """
    return (
        fma(x[1], p[5], fma(-x[2], p[4], x[3] * p[3])),
        fma(x[2], p[2], fma(-x[0], p[5], -x[3] * p[1])),
        fma(x[0], p[4], fma(-x[1], p[2], x[3] * p[0])),
        fma(x[1], p[1], fma(-x[0], p[3], -x[2] * p[0])),
    )


@inlined
def adjugate(a: tuple, b: tuple, c: tuple, d: tuple) -> tuple[tuple[float, ...], ...]:
    """The rows of the inverse of [a, b, c, d] times the determinant, which is that of ``a`` and the
    first row.
    """
    first, last = pairs(a, b), pairs(c, d)
    return across(b, last), minus(across(a, last)), across(d, first), minus(across(c, first))


@inlined
def minus(x: tuple) -> tuple[float, ...]:
    """−``x`` of four numbers."""
    return -x[0], -x[1], -x[2], -x[3]


@inlined
def product(rows: tuple, share: float, x: tuple) -> tuple[float, ...]:
    """``share`` times the four ``rows`` times ``x``."""
    return (
        share * dot(rows[0], x),
        share * dot(rows[1], x),
        share * dot(rows[2], x),
        share * dot(rows[3], x),
    )


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
    length = np.sqrt(fma(x[4], x[4], dot(x, x)))
    over = 1 / (x[4] + np.copysign(length, x[4]))
    return x[0] * over, x[1] * over, x[2] * over, x[3] * over


@inlined
def without(x: tuple, share: float, y: tuple) -> tuple[float, ...]:
    """The four numbers ``x`` − ``share``·``y``."""
    return (
        fma(-share, y[0], x[0]),
        fma(-share, y[1], x[1]),
        fma(-share, y[2], x[2]),
        fma(-share, y[3], x[3]),
    )
