"""Samples spread on the nodes of a grid by the quadratic B-spline, compiled.

A sample adds to 3 × 3 nodes. The three of a row lie side by side, and are added to at once together
with the node behind them, whose share is 0: the compiler, which knows no more than one addition
after the other, would make three. What is added to each node, and in which order, depends on the
samples alone.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import float64, int64, types
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from pipeline.core.compiled import compiled

NODES = 3  # of a sample, in either direction
WIDTH = 4  # nodes that are added to at once
FOUR = ir.VectorType(ir.DoubleType(), WIDTH)
# shares of three nodes as c₀ + t(c₁ + t·c₂), t in [0, 1) from halfway between the first two to
# halfway between the last two; the fourth has none
SHARES = tuple(
    ir.Constant(FOUR, row)
    for row in ([0.5, 0.5, 0.0, 0.0], [-1.0, 1.0, 0.0, 0.0], [0.5, -1.0, 0.5, 0.0])
)


def spread(samples: np.ndarray, low: np.ndarray, step: np.ndarray, masses: np.ndarray) -> None:
    """Add to ``masses`` (rows, columns), one behind the other, those of ``samples`` (N, 2) on nodes
    from ``low`` (2,) on, ``step`` (2,) apart; of those that lie inside, the last column left free.
    """
    _spread(np.ascontiguousarray(samples, dtype=float), low, step, masses)


@compiled()
def _spread(samples: np.ndarray, low: np.ndarray, step: np.ndarray, masses: np.ndarray) -> None:
    rows, columns = masses.shape
    flat = masses.reshape(-1)
    start0, start1, per0, per1 = low[0], low[1], 1 / step[0], 1 / step[1]
    for i in range(samples.shape[0]):
        # the nearest node and the one before it, from which the three count
        row, column = (samples[i, 0] - start0) * per0 - 0.5, (samples[i, 1] - start1) * per1 - 0.5
        if (0.0 <= row) & (row < rows - 2) & (0.0 <= column) & (column < columns - 3):
            first_row, first_column = np.int64(row), np.int64(column)
            place = first_row * columns + first_column
            _add(flat, place, columns, row - first_row, column - first_column)


@intrinsic
def _add(
    typingctx: object, flat: object, place: object, columns: object, down: object, across: object
) -> tuple:
    """Add to ``flat`` from ``place`` on, in three rows ``columns`` apart, the shares of a sample
    that lies at ``down`` and ``across`` between its nodes.
    """

    def code(context: object, builder: ir.IRBuilder, signature: Signature, given: list) -> object:
        array, place, columns, down, across = given
        first = context.make_array(signature.args[0])(context, builder, array).data
        of_rows, of_columns = _shares(builder, down), _shares(builder, across)
        for k in range(NODES):
            four = builder.bitcast(builder.gep(first, [place]), FOUR.as_pointer())
            share = builder.fmul(_of_all(builder, of_rows, k), of_columns)
            builder.store(builder.fadd(builder.load(four, align=8), share), four, align=8)
            place = builder.add(place, columns)
        return context.get_dummy_value()

    return types.void(flat, int64, int64, float64, float64), code


def _shares(builder: ir.IRBuilder, t: object) -> object:
    """The vector of :data:`SHARES` at ``t``."""
    lone = builder.insert_element(ir.Constant(FOUR, ir.Undefined), t, ir.IntType(32)(0))
    four = _of_all(builder, lone, 0)
    slope = builder.fadd(SHARES[1], builder.fmul(four, SHARES[2]))
    return builder.fadd(SHARES[0], builder.fmul(four, slope))


def _of_all(builder: ir.IRBuilder, four: object, k: int) -> object:
    """A vector whose numbers are all the ``k``-th of ``four``."""
    which = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [k] * WIDTH)
    return builder.shuffle_vector(four, four, which)
