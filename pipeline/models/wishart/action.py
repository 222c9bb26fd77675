"""What B⁻¹ and a constant matrix do to m rows of a block, for compiled laws of any arm."""

from __future__ import annotations

import numpy as np

from pipeline.arm.whole_pose import dot_six, five, put_six, six
from pipeline.core.compiled import inner
from pipeline.core.elementary import expm1, fma
from pipeline.models.law import Numbers


@inner
def act_on_three(
    numbers: Numbers, d: float, a1: np.ndarray, a2: np.ndarray, a3: np.ndarray, count: int
) -> None:
    """Make of a, of three task rows, B⁻¹a and of the normals T; see :func:`act`.

    Two loops: in one each pose would wait for the root and the quotient before it.
    """
    gamma, first, second = numbers.chi_square[0], numbers.normal[0], numbers.normal[1]
    share = 1 / (d - 1)
    for i in range(count):
        square = first[i] * first[i] + second[i] * second[i]
        stretch = np.sqrt(expm1(square * share) / square)
        first[i] *= stretch
        second[i] *= stretch
    for i in range(count):
        b1, b2, b3, t2, t3 = a1[i], a2[i], a3[i], first[i], second[i]
        r = np.sqrt(fma(b1, b1, fma(b2, b2, b3 * b3)))
        reach = r + abs(b1)
        z = d / gamma[i]
        along = fma(b2, t2, b3 * t3) / (reach if reach > 0 else 1.0)
        a1[i] = z * fma(-along, b1 + np.copysign(r, b1), b1)
        a2[i] = z * fma(r, t2, fma(-along, b2, b2))
        a3[i] = z * fma(r, t3, fma(-along, b3, b3))


@inner
def act_on_six(numbers: Numbers, d: float, first: int, count: int) -> None:
    """The same of six task rows, from row ``first`` of the room on; see :func:`act`."""
    rows, normal = numbers.room.reshape(-1), numbers.normal.reshape(-1)
    gamma, other = numbers.chi_square[0], numbers.chi_square[1]
    for i in range(np.uint64(count)):
        a, n = six(rows, first, i), five(normal, 0, i)
        stretch, z = 1 / np.sqrt(other[i]), d / gamma[i]
        r = np.sqrt(dot_six(a, a))
        reach = r + abs(a[0])
        product = fma(a[1], n[0], fma(a[2], n[1], a[3] * n[2])) + fma(a[4], n[3], a[5] * n[4])
        along = stretch * product / (reach if reach > 0 else 1.0)
        own, across = z * (1 - along), z * r * stretch
        put_six(
            rows,
            first,
            i,
            (
                z * fma(-along, a[0] + np.copysign(r, a[0]), a[0]),
                fma(across, n[0], own * a[1]),
                fma(across, n[1], own * a[2]),
                fma(across, n[2], own * a[3]),
                fma(across, n[3], own * a[4]),
                fma(across, n[4], own * a[5]),
            ),
        )


@inner
def act(numbers: Numbers, d: float, first: int, m: int, spare: int, count: int) -> None:
    """Make of a, m rows of the room from ``first`` on, B⁻¹a = z(a + rR[0, T]ᵀ), zero where a is;
    ``spare`` is the first of four rows of scratch.

    T = N/sqrt(χ²(d−m+2)) of m − 1 normals; of two of them ‖T‖ has a closed form, see
    :mod:`.step`. R is the Householder reflection of the first axis to a/r, up to its sign.
    """
    room, normal, a1 = numbers.room, numbers.normal, numbers.room[first]
    if m == 3:
        act_on_three(numbers, d, a1, room[first + 1], room[first + 2], count)
        return
    if m == 6:
        act_on_six(numbers, d, first, count)
        return
    stretch, r, along, z = room[spare], room[spare + 1], room[spare + 2], room[spare + 3]
    for i in range(count):
        r[i] = 0.0
        along[i] = 0.0
    for k in range(m):
        a = room[first + k]
        for i in range(count):
            r[i] += a[i] * a[i]
    if m > 1:
        for i in range(count):
            stretch[i] = 1 / np.sqrt(numbers.chi_square[1, i])
    for k in range(1, m):
        a, n = room[first + k], normal[k - 1]
        for i in range(count):
            along[i] += a[i] * (stretch[i] * n[i])
    for i in range(count):
        r[i] = np.sqrt(r[i])
        reach = r[i] + abs(a1[i])
        along[i] *= 1 / reach if reach > 0 else 0.0
        z[i] = d / numbers.chi_square[0, i]
        a1[i] = z[i] * (a1[i] - along[i] * (a1[i] + np.copysign(r[i], a1[i])))
    for k in range(1, m):
        a, n = room[first + k], normal[k - 1]
        for i in range(count):
            a[i] = z[i] * (a[i] + r[i] * (stretch[i] * n[i]) - along[i] * a[i])


@inner
def multiply(
    room: np.ndarray, matrix: np.ndarray, first: int, m: int, spare: int, count: int
) -> None:
    """Make of x, m rows of ``room`` from ``first`` on, ``matrix`` x, row by row (m·m,); ``spare``
    is the first of m rows of scratch.
    """
    for r in range(m):
        result = room[spare + r]
        for i in range(count):
            result[i] = 0.0
        for s in range(m):
            entry, x = matrix[r * m + s], room[first + s]
            for i in range(count):
                result[i] += entry * x[i]
    for r in range(m):
        result, x = room[spare + r], room[first + r]
        for i in range(count):
            x[i] = result[i]
