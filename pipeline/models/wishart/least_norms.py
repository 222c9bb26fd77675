"""The least sum of two norms, ‖ω − Ay‖ + λ‖y‖, for matrices of any size in bulk: what is left of
(BsampOpt) once S is a function of y (:mod:`.perturbation`).

With the singular values σ of A (n, m), n ≥ m, c = Uᵀω the parts of ω along its left vectors and ω⊥
what no y explains, a stationary point is y_i = σ_i c_i/(σ_i² + μ) with μ = λ‖ω − Ay‖/‖y‖ > 0, so

    Σ_i (σ_i² − λ²) c_i²/(σ_i² + μ)² = λ²‖ω⊥‖²/μ².

With p = (AAᵀ + μI)⁻¹ω that is ‖Aᵀp‖ = λ‖p‖. ‖Aᵀp‖²/‖p‖² is a mean of the eigenvalues of AAᵀ, with
n − m zeros for ω⊥, whose weights move to the larger ones as μ grows: so there is one root, or none.
Where the mean exceeds λ² already as μ → 0 the noise is explained exactly, y = A⁻¹ω, as it can be
where ω⊥ = 0 alone; where it stays below λ² as μ → ∞, y = 0.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled, inner
from pipeline.models.wishart.singular import orthogonalize

# eight are usual; in so many halvings t would be known to the last bit, however small
ROOT_STEPS = 100
SETTLED = 1e-9  # last step, as a share of t: Newton's next would be of the size of its square
# share of ω below which what is left of it across A is rounding
LEAST_REST = 1e-14


def least_sum_of_norms(noise: np.ndarray, matrix: np.ndarray, ratio: float) -> np.ndarray:
    """(N, m) argmin over y of ‖ω − Ay‖ + λ‖y‖ for ``noise`` ω (N, n), ``matrix`` A (N, n, m) of
    full column rank and ``ratio`` λ ≥ 0; for λ = 0 that of least squares.
    """
    count, n, m = matrix.shape
    result = np.zeros((count, m))
    _solve(
        np.ascontiguousarray(noise),
        np.ascontiguousarray(matrix),
        float(ratio),
        result,
        np.empty((m, n)),
        np.empty((m, m)),
        np.empty((2, m)),
        np.empty(n),
    )
    return result


@compiled()
def _solve(
    noise: np.ndarray,
    matrix: np.ndarray,
    ratio: float,
    result: np.ndarray,
    columns: np.ndarray,
    turn: np.ndarray,
    spectrum: np.ndarray,
    rest: np.ndarray,
) -> None:
    """Fill ``result`` (N, m), zero before; what follows it is room."""
    (m, n), bound = columns.shape, ratio * ratio
    for number in range(len(noise)):
        omega, pull, size = noise[number], 0.0, 0.0
        for j in range(m):
            product = 0.0
            for i in range(n):
                columns[j, i] = matrix[number, i, j]
                product += columns[j, i] * omega[i]
            pull += product * product
        for i in range(n):
            size += omega[i] * omega[i]
        if pull < bound * size or pull == 0.0:
            continue
        for i in range(m):
            for j in range(m):
                turn[i, j] = 1.0 if i == j else 0.0
        orthogonalize(columns, turn)
        for i in range(n):
            rest[i] = omega[i]
        for j in range(m):
            square = product = 0.0
            for i in range(n):
                square += columns[j, i] * columns[j, i]
                product += columns[j, i] * omega[i]
            # σ² and c·σ
            spectrum[0, j], spectrum[1, j] = square, product
            for i in range(n):
                rest[i] -= product / square * columns[j, i]
        left = 0.0
        if n > m:
            for i in range(n):
                left += rest[i] * rest[i]
            if left < LEAST_REST * LEAST_REST * size:
                left = 0.0
        mu = _root(spectrum, left, ratio)
        for j in range(m):
            share = spectrum[1, j] / (spectrum[0, j] + mu)
            for i in range(m):
                result[number, i] += share * turn[j, i]


@inner
def _sides(
    spectrum: np.ndarray, scale: float, left: float, t: float
) -> tuple[float, float, float, float]:
    """‖Aᵀp‖² and ‖p‖² at μ = scale·t/(1 − t), but for a factor that they share, and half of their
    slopes by t.
    """
    u, image, length, image_slope, length_slope = 1 - t, 0.0, 0.0, 0.0, 0.0
    for j in range(spectrum.shape[1]):
        square = spectrum[0, j]
        over = 1 / (u * (square / scale) + t)
        pulled = spectrum[1, j] * over
        pulled *= pulled
        part, slope = pulled / square, (square / scale - 1) * over
        image += pulled
        image_slope += pulled * slope
        length += part
        length_slope += part * slope
    if left > 0.0:
        # p has ω⊥/μ too; all is multiplied by t²
        image_slope = t * (t * image_slope + image)
        length_slope = t * (t * length_slope + length)
        image, length = t * t * image, t * t * length + left
    return image, length, image_slope, length_slope


@inner
def _root(spectrum: np.ndarray, left: float, ratio: float) -> float:
    """μ ≥ 0, where ‖Aᵀp‖ = λ‖p‖, of σ² and c·σ ``spectrum`` (2, m) and ``left`` ‖ω⊥‖²; 0 where
    ‖Aᵀp‖ is not less as μ → 0.

    Newton's steps in t of μ = scale·t/(1 − t), t in [0, 1), and halvings where they would leave
    what the signs have not ruled out.
    """
    scale = 0.0
    for j in range(spectrum.shape[1]):
        scale += spectrum[0, j]
    image, length, _, _ = _sides(spectrum, scale, left, 0.0)
    if ratio == 0.0 or (left == 0.0 and image >= ratio * ratio * length):
        return 0.0
    low, high, t = 0.0, 1 - np.finfo(np.float64).eps, 0.5
    for _ in range(ROOT_STEPS):
        image, length, image_slope, length_slope = _sides(spectrum, scale, left, t)
        image, length = np.sqrt(image), ratio * np.sqrt(length)
        value = image - length
        slope = image_slope / image - ratio * ratio * length_slope / length
        if value < 0:
            low = t
        else:
            high = t
        following = t - value / slope
        if not low <= following <= high:
            following = (low + high) / 2
        move, t = abs(following - t), following
        if move <= SETTLED * t:
            break
    return scale * t / (1 - t)
