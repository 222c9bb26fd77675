"""A step of the Wishart model with measurement noise as a mixture of normals over z and g, in the
numbers that the quadrature over both needs (:mod:`.quadrature`).

Given z and g the step is normal: of mean z·b, b = J₂⁺a, and covariance Σ_m + (z²/g)MMᵀ, M =
r·J₂⁺(I − eeᵀ) of rank m − 1. In units in which Σ_m = I, by y = L⁻¹(q_{k+1} − q_k) of Σ_m = LLᵀ, and
b and M likewise, the left vectors u_i of M with the squares λ_i of its singular values are
independent of each other and of all that is across them:

    −2 ln N = ‖y⊥ − z·b⊥‖² + Σ_i [(c_i − z·k_i)²/(1 + λ_i z²/g) + ln(1 + λ_i z²/g)] + constant,

c_i = u_iᵀy, k_i = u_iᵀb, and the first term is ‖b⊥‖²(z − z₀)² and what no z explains. So there are
three numbers and three for each of m − 1 directions, and nothing grows with the number of joints.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled
from pipeline.models.wishart.singular import orthogonalize

ALONG, DIRECTION = 3, 3  # numbers before those of the directions, and of each


def mixture(y: np.ndarray, a: np.ndarray, back: np.ndarray) -> np.ndarray:
    """(N, 3 + 3(m − 1)) of N steps z₀, ‖b⊥‖² and ‖y⊥ − z₀b⊥‖², then c_i, k_i and λ_i of each
    direction.

    ``y`` L⁻¹(q_{k+1} − q_k) (N, n), ``a`` J₁⁻¹v (N, m) not zero, ``back`` L⁻¹J₂⁺ (N, n, m).
    """
    count, n, m = back.shape
    result = np.empty((count, ALONG + DIRECTION * (m - 1)))
    _fill(
        result,
        np.ascontiguousarray(y),
        np.ascontiguousarray(a),
        np.ascontiguousarray(back),
        np.empty((m - 1, n)),
        np.empty((m - 1, 0)),
        np.empty((2, n)),
        np.empty(m),
    )
    return result


@compiled
def _fill(
    result: np.ndarray,
    y: np.ndarray,
    a: np.ndarray,
    back: np.ndarray,
    columns: np.ndarray,
    none: np.ndarray,
    left: np.ndarray,
    mirror: np.ndarray,
) -> None:
    """Fill ``result``; ``columns`` (m − 1, n) and what follows is room."""
    _, n, m = back.shape
    for number in range(len(result)):
        case, matrix, action, square = result[number], back[number], a[number], 0.0
        for j in range(m):
            mirror[j] = action[j]
            square += action[j] * action[j]
        # Householder's reflection of a to the first axis: its other columns span what is across e
        r = np.sqrt(square)
        mirror[0] += np.copysign(r, action[0])
        over = 1 / (r + abs(action[0]))
        for i in range(n):
            b = mirrored = 0.0
            for j in range(m):
                b += matrix[i, j] * action[j]
                mirrored += matrix[i, j] * mirror[j]
            left[0, i], left[1, i] = y[number, i], b
            for j in range(m - 1):
                columns[j, i] = r * matrix[i, j + 1] - over * mirrored * mirror[j + 1]
        orthogonalize(columns, none)
        for j in range(m - 1):
            size = c = k = 0.0
            for i in range(n):
                size += columns[j, i] * columns[j, i]
                c += columns[j, i] * left[0, i]
                k += columns[j, i] * left[1, i]
            for i in range(n):
                left[0, i] -= c / size * columns[j, i]
                left[1, i] -= k / size * columns[j, i]
            length, place = np.sqrt(size), ALONG + DIRECTION * j
            case[place], case[place + 1], case[place + 2] = c / length, k / length, size
        precision = product = 0.0
        for i in range(n):
            precision += left[1, i] * left[1, i]
            product += left[0, i] * left[1, i]
        case[0], case[1], case[2] = product / precision, precision, 0.0
        if n > m:
            for i in range(n):
                case[2] += (left[0, i] - case[0] * left[1, i]) ** 2
