"""Row layout of a block in compiled code, a C-ordered matrix (rows, poses). A row has one quantity
at consecutive poses: LLVM vectorises loops over a row without branches or calls.
"""

from typing import NamedTuple

from pipeline.core.compiled import inner, lanes

WIDTH = 256  # poses of a block: a smaller block needs more calls, a larger exceeds the cache
# rows of the kinematics of a pose: position (3, m) and rotation (9, row by row) of the tip; sine
# and cosine of one frame's angle, or the rotation vector (3) of a displacement; from JOINTS on for
# each joint its axis (3) and a point of the axis (3, m)
POSITION = 0
ROTATION = 3
SINE = 12
COSINE = 13
TURN = 12
JOINTS = 15


class Rows(NamedTuple):
    """First row of each quantity of n joints and m task rows, and the number of rows ``size``."""

    jacobian: int  # (m·n) J, row by row
    lower: int  # (m·m) L of JJᵀ = LLᵀ, row by row
    inverse: int  # (m) 1/L_rr
    task: int  # (m) task step
    joints: int  # (n) joint step
    singular: int  # 1 at a singular pose, else 0
    speed: int  # ‖v‖²
    normal: int  # (n + m) normal variates
    chi_square: int  # (2) χ² variates
    spare: int  # (m·n + m·m + 2m + 4) scratch
    size: int


def block_rows(n: int, m: int) -> Rows:
    """Rows of a block for ``n`` joints and ``m`` task rows."""
    jacobian = JOINTS + 6 * n
    lower = jacobian + m * n
    inverse = lower + m * m
    task = inverse + m
    joints = task + m
    singular = joints + n
    normal = singular + 2
    chi_square = normal + n + m
    spare = chi_square + 2
    places = (
        jacobian,
        lower,
        inverse,
        task,
        joints,
        singular,
        singular + 1,
        normal,
        chi_square,
    )
    return Rows(*places, spare, spare + m * n + m * m + 2 * m + 4)


rows_of = inner(block_rows)


@inner
def fill(block, out, value, count):
    """Set row ``out`` of the ``block`` to ``value`` at the first ``count`` poses."""
    for i in lanes(count):
        block[out, i] = value


@inner
def copy(block, out, x, count):
    """Set row ``out`` to row ``x``."""
    for i in lanes(count):
        block[out, i] = block[x, i]


@inner
def scale(block, out, x, count):
    """Multiply row ``out`` by row ``x``."""
    for i in lanes(count):
        block[out, i] *= block[x, i]


@inner
def add_product(block, out, sign, x, y, count):
    """Add ``sign``·row ``x``·row ``y`` to row ``out``."""
    for i in lanes(count):
        block[out, i] += sign * (block[x, i] * block[y, i])


@inner
def add_dot(block, out, sign, x, y, n, count, by=1):
    """Add ``sign``·Σ_j row (``x`` + ``by``·j)·row (``y`` + j), j < ``n``, to row ``out``."""
    for j in range(0, n - 2, 3):
        first = x + by * j
        second = first + by
        third = first + 2 * by
        at = y + j
        for i in lanes(count):
            product = block[first, i] * block[at, i]
            product += block[second, i] * block[at + 1, i]
            product += block[third, i] * block[at + 2, i]
            block[out, i] += sign * product
    for j in range(n - n % 3, n):
        add_product(block, out, sign, x + by * j, y + j, count)


@inner
def dot(block, out, x, y, n, count):
    """Set row ``out`` to Σ_j row (``x`` + j)·row (``y`` + j), j < ``n``."""
    if n < 3:
        fill(block, out, 0.0, count)
        add_dot(block, out, 1.0, x, y, n, count)
        return
    for i in lanes(count):
        product = block[x, i] * block[y, i]
        product += block[x + 1, i] * block[y + 1, i]
        product += block[x + 2, i] * block[y + 2, i]
        block[out, i] = product
    add_dot(block, out, 1.0, x + 3, y + 3, n - 3, count)


@inner
def add_combination(block, out, factors, at, x, n, count):
    """Add Σ_j ``factors``[``at`` + j]·row (``x`` + j), j < ``n``, to row ``out``."""
    for j in range(n):
        factor = factors[at + j]
        row = x + j
        for i in lanes(count):
            block[out, i] += factor * block[row, i]
