"""Sums over particles, compiled: of the same bits on every processor, and of several numbers at
once.

A sum that is taken one number after the other waits for each of them, and one that the compiler may
take in another order has other bits where the processor is wider. So number i belongs to lane i
modulo :data:`LANES`, each lane is summed by itself, and the lanes are joined at the end, half and
half: an order that says nothing of a processor.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numba import float64, int64
from numba.core import cgutils
from numba.extending import intrinsic

from pipeline.core.compiled import inner

LANES = 16


def in_lanes(start: float, add: Callable, join: Callable) -> Callable:
    """The compiled function of arrays, in a tuple, and how many of their first numbers it takes, a
    multiple of LANES: lanes that begin at ``start``, to which ``add(builder, lanes, *numbers)``
    adds LANES numbers of each array, and of which ``join(builder, lanes, others)`` makes one.
    """

    def code(context: object, builder: ir.IRBuilder, signature: object, values: list) -> object:
        each = cgutils.unpack_tuple(builder, values[0])
        first = [
            context.make_array(kind)(context, builder, value=array).data
            for kind, array in zip(signature.args[0], each, strict=True)
        ]
        wide = ir.VectorType(ir.DoubleType(), LANES)
        lanes = cgutils.alloca_once_value(builder, ir.Constant(wide, [start] * LANES))
        zero, step = (context.get_constant(int64, value) for value in (0, LANES))
        with cgutils.for_range_slice(builder, zero, values[1], step) as (i, _):
            places = [builder.bitcast(builder.gep(p, [i]), wide.as_pointer()) for p in first]
            numbers = [builder.load(place, align=8) for place in places]
            builder.store(add(builder, builder.load(lanes), *numbers), lanes)
        result, half = builder.load(lanes), LANES // 2
        while half > 0:
            result = join(builder, *(_part(builder, result, k, half) for k in (0, half)))
            half //= 2
        return builder.extract_element(result, ir.Constant(ir.IntType(32), 0))

    def typed(typingctx: object, arrays: object, count: object) -> tuple:
        return float64(arrays, int64), code

    return intrinsic(typed)


def _part(builder: ir.IRBuilder, lanes: object, first: int, size: int) -> object:
    """``size`` of the ``lanes`` from the ``first`` on."""
    which = ir.Constant(ir.VectorType(ir.IntType(32), size), [*range(first, first + size)])
    return builder.shuffle_vector(lanes, lanes, which)


def _greater(builder: ir.IRBuilder, one: object, other: object) -> object:
    return builder.select(builder.fcmp_ordered(">", one, other), one, other)


_products = in_lanes(
    0.0, lambda builder, lanes, x, y: builder.fadd(builder.fmul(x, y), lanes), ir.IRBuilder.fadd
)
_sum = in_lanes(0.0, ir.IRBuilder.fadd, ir.IRBuilder.fadd)
_greatest = in_lanes(-np.inf, lambda builder, lanes, x: _greater(builder, x, lanes), _greater)


@inner
def inner_product(x: np.ndarray, y: np.ndarray) -> float:
    """Σ x_i y_i."""
    whole = len(x) // LANES * LANES
    result = _products((x, y), whole)
    for i in range(whole, len(x)):
        result += x[i] * y[i]
    return result


@inner
def total(x: np.ndarray) -> float:
    """Σ x_i."""
    whole = len(x) // LANES * LANES
    result = _sum((x,), whole)
    for i in range(whole, len(x)):
        result += x[i]
    return result


@inner
def greatest(x: np.ndarray) -> float:
    """The greatest of ``x``, which may be −∞; NaN is not looked at."""
    whole = len(x) // LANES * LANES
    result = _greatest((x,), whole)
    for i in range(whole, len(x)):
        result = x[i] if x[i] > result else result
    return result
