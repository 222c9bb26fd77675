"""Elementary functions and sums for compiled loops: vectorised, with equal bits on all processors.

Arguments are reduced to near zero, where a polynomial suffices, without branches or calls. Term i
of a sum is added to partial sum i modulo 8, and the eight partial sums are added at the end.
"""

from math import factorial, log, pi

import numpy as np

from pipeline.core.compiled import choose, inlined, inner

# added to a number x, it gives a sum whose lowest bits are the integer nearest to x
MAGIC = 1.5 * 2.0**52
# π/2 and ln 2 in parts of 33 bits, whose products with small integers are exact, and a remainder
# (Sun Microsystems, fdlibm, 1993)
QUARTER = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624879595063154e-21,
)
LOG_2 = 6.93147180369123816490e-01, 1.90821492927058770002e-10
# within π/4 of zero, r = x²: sin x = x + x³·S(r), cos x = 1 − r/2 + r²·C(r) (fdlibm)
SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
)
SINE += (
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
)
COSINE += (
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
# Taylor series of exp(x) = 1 + x + x²·E(x): within (ln 2)/2 of zero the first omitted term is
# below half a unit in the last place
EXPONENTIAL = tuple(1 / factorial(k + 2) for k in range(12))
LEAST = -708.0  # below it exp(x) is not a normal number
LANES = 8  # partial sums


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """Return sin and cos of ``angle`` in rad, to within 2e-16 up to a thousand turns."""
    shifted = angle * (2 / pi) + MAGIC
    turns = shifted - MAGIC
    quadrant = np.float64(shifted).view(np.int64)
    x = ((angle - turns * QUARTER[0]) - turns * QUARTER[1]) - turns * QUARTER[2]
    square = x * x
    sine = SINE[5]
    cosine = COSINE[5]
    for k in range(4, -1, -1):
        sine = sine * square + SINE[k]
        cosine = cosine * square + COSINE[k]
    sine = x + x * square * sine
    cosine = 1.0 - (0.5 * square - square * square * cosine)
    # the angle is x and a number of quadrants, of which the last two bits count
    odd = (quadrant & 1) != 0
    s = choose(odd, cosine, sine)
    c = choose(odd, sine, cosine)
    s_negative = (quadrant & 2) != 0
    c_negative = ((quadrant + 1) & 2) != 0
    return choose(s_negative, -s, s), choose(c_negative, -c, c)


@inlined
def exponential_parts(x: float) -> tuple[float, float]:
    """Return 2ᵏ and exp(y) − 1 for x = k·ln 2 + y, |x| ≤ 708 and |y| ≤ (ln 2)/2."""
    shifted = x * (1 / log(2)) + MAGIC
    k = shifted - MAGIC
    y = (x - k * LOG_2[0]) - k * LOG_2[1]
    series = EXPONENTIAL[11]
    for i in range(10, -1, -1):
        series = series * y + EXPONENTIAL[i]
    # the exponent bits of 1, raised by k
    exponent = np.float64(shifted).view(np.int64) + 1023
    power = np.int64(exponent << 52).view(np.float64)
    return power, y + y * y * series


@inlined
def exponential(x: float) -> float:
    """Return exp(x) for x ≤ 700, to within two units in the last place; 0 below −708."""
    power, less_one = exponential_parts(LEAST if x < LEAST else x)
    return 0.0 if x < LEAST else power + power * less_one


@inlined
def expm1(x: float) -> float:
    """Return exp(x) − 1 for 0 ≤ x < 700, to within three units in the last place."""
    power, less_one = exponential_parts(x)
    return power * less_one + (power - 1.0)


@inner
def inner_product(x: np.ndarray, y: np.ndarray) -> float:
    """Return Σ x_i y_i."""
    a = b = c = d = e = f = g = h = 0.0
    whole = len(x) // LANES * LANES
    for i in range(0, whole, LANES):
        a += x[i] * y[i]
        b += x[i + 1] * y[i + 1]
        c += x[i + 2] * y[i + 2]
        d += x[i + 3] * y[i + 3]
        e += x[i + 4] * y[i + 4]
        f += x[i + 5] * y[i + 5]
        g += x[i + 6] * y[i + 6]
        h += x[i + 7] * y[i + 7]
    for i in range(whole, len(x)):
        a += x[i] * y[i]
    return ((a + e) + (c + g)) + ((b + f) + (d + h))


@inner
def total(x: np.ndarray) -> float:
    """Return Σ x_i."""
    a = b = c = d = e = f = g = h = 0.0
    whole = len(x) // LANES * LANES
    for i in range(0, whole, LANES):
        a += x[i]
        b += x[i + 1]
        c += x[i + 2]
        d += x[i + 3]
        e += x[i + 4]
        f += x[i + 5]
        g += x[i + 6]
        h += x[i + 7]
    for i in range(whole, len(x)):
        a += x[i]
    return ((a + e) + (c + g)) + ((b + f) + (d + h))


@inner
def greatest(x: np.ndarray) -> float:
    """Return the greatest value of ``x``, which may be −∞; NaN is ignored."""
    a = b = c = d = -np.inf
    whole = len(x) // 4 * 4
    for i in range(0, whole, 4):
        a = x[i] if x[i] > a else a
        b = x[i + 1] if x[i + 1] > b else b
        c = x[i + 2] if x[i + 2] > c else c
        d = x[i + 3] if x[i + 3] > d else d
    for i in range(whole, len(x)):
        a = x[i] if x[i] > a else a
    a = a if a > b else b
    c = c if c > d else d
    return a if a > c else c
