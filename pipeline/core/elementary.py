"""Elementary functions for compiled loops: without a branch or a call, so that the compiler takes
several numbers at once, and of the same bits on every processor.

The C library's are as good, but take one number at a time, and their bits differ from one to
another. Each argument is brought near zero, where a polynomial is enough. What is multiplied and
added is rounded once, by :func:`fma`; LLVM neither makes such a pair by itself nor takes one apart.
"""

from __future__ import annotations

from math import factorial, log, pi, sin

from llvmlite import ir
from numba import float64, int64
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from pipeline.core.compiled import inlined

# added to a number it leaves the nearest whole one in the lowest bits of the sum
MAGIC = 1.5 * 2.0**52
# the doubles nearest to π/2 and ln 2, of which the latter lacks its last bits, and what they lack:
# sin(pi) is what π lacks as a double
QUARTER, REST_OF_QUARTER = pi / 2, sin(pi) / 2
LOG_2, REST_OF_LOG_2 = log(2), 2.3190468138462996e-17
# within π/4 of zero, by r = x²: sin x = x + x³·S(r), cos x = 1 − r/2 + r²·C(r) (Sun Microsystems,
# fdlibm, 1993)
SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
# Taylor's of exp(x) = 1 + x + x²·E(x): within (ln 2)/2 of zero the first term left out is below
# half a unit in the last place
EXPONENTIAL = tuple(1 / factorial(k + 2) for k in range(12))
LEAST = -708.0  # below it an exponential is no normal number any more


@intrinsic
def fma(typingctx: object, x: object, y: object, z: object) -> tuple:
    """x·y + z, rounded once."""

    def code(context: object, builder: ir.IRBuilder, signature: Signature, given: list) -> object:
        return builder.fma(*given)

    return float64(float64, float64, float64), code


@intrinsic
def bits(typingctx: object, x: object) -> tuple:
    """The 64 bits of a float, as a whole number."""

    def code(context: object, builder: ir.IRBuilder, signature: Signature, given: list) -> object:
        return builder.bitcast(given[0], ir.IntType(64))

    return int64(float64), code


@intrinsic
def of_bits(typingctx: object, x: object) -> tuple:
    """The float of these 64 bits."""

    def code(context: object, builder: ir.IRBuilder, signature: Signature, given: list) -> object:
        return builder.bitcast(given[0], ir.DoubleType())

    return float64(int64), code


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """sin and cos of ``angle`` in rad, to within 2e-16 up to a thousand turns."""
    shifted = fma(angle, 1 / QUARTER, MAGIC)
    turns, quadrant = MAGIC - shifted, bits(shifted)  # negative quarter turns
    x = fma(turns, REST_OF_QUARTER, fma(turns, QUARTER, angle))
    square = x * x
    sine, cosine = SINE[5], COSINE[5]
    for k in range(4, -1, -1):
        sine = fma(sine, square, SINE[k])
        cosine = fma(cosine, square, COSINE[k])
    sine = fma(square * x, sine, x)
    cosine = fma(square * square, cosine, fma(square, -0.5, 1.0))
    odd = (quadrant & 1) != 0
    s, c = (cosine if odd else sine), (sine if odd else cosine)
    # the sign bits
    return (
        of_bits(bits(s) ^ ((quadrant & 2) << 62)),
        of_bits(bits(c) ^ (((quadrant + 1) & 2) << 62)),
    )


@inlined
def exponential_parts(x: float) -> tuple[float, float]:
    """2ᵏ and exp(y) − 1 for x = k·ln 2 + y, x between ±708 and y within (ln 2)/2 of zero."""
    shifted = fma(x, 1 / LOG_2, MAGIC)
    k = MAGIC - shifted  # negative
    y = fma(k, REST_OF_LOG_2, fma(k, LOG_2, x))
    result = EXPONENTIAL[11]
    for i in range(10, -1, -1):
        result = fma(result, y, EXPONENTIAL[i])
    # the exponent of 1, raised by k
    return of_bits((bits(shifted) + 1023) << 52), fma(y * y, result, y)


@inlined
def exponential(x: float) -> float:
    """exp(x) for x ≤ 700 to within two units in the last place; 0 below −708."""
    power, less_one = exponential_parts(LEAST if x < LEAST else x)
    return 0.0 if x < LEAST else fma(power, less_one, power)


@inlined
def expm1(x: float) -> float:
    """exp(x) − 1 for 0 ≤ x < 700, to within three units in the last place."""
    power, less_one = exponential_parts(x)
    return fma(power, less_one, power - 1.0)
