"""(ũ, α) of the Gaussian matrix model: the paper's distance of one-step moments, minimised exactly
in α for every ũ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ModelDomainError


@dataclass(frozen=True)
class GaussianFit:
    """The optimum and the ridge it lies on: for each of ``extensions`` (G,) the least
    ``objectives`` (G,) and its ``alphas`` (G,).
    """

    alpha: float
    u: float  # û = max_k ‖J̲_k⁺‖_F + ũ
    extension: float  # ũ > 0
    objective: float  # what was minimised: F, rad and rad² mixed as in the paper, or −Σ ln p
    # whether ũ stopped at an end of its interval, so that the data do not determine it
    at_end: bool
    extensions: np.ndarray
    objectives: np.ndarray
    alphas: np.ndarray


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """The least x that minimises Σ w|x − value|, for ``values`` and positive ``weights`` (N,)."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])


def search(
    best: Callable[[float], tuple[float, float]], extensions: np.ndarray, largest: float
) -> GaussianFit:
    """The best of ``extensions`` ũ (G,), ascending, and what lies between its neighbours.

    ``best`` gives the least objective at one extension and its α; ``largest`` is the norm that is
    extended.
    """
    from scipy.optimize import minimize_scalar

    objectives, alphas = np.array([best(float(extension)) for extension in extensions]).T
    i = int(objectives.argmin())
    extension = float(extensions[i])
    at_end = i in (0, len(extensions) - 1)
    if not at_end:
        refined = minimize_scalar(
            lambda x: best(x)[0], bounds=(extensions[i - 1], extensions[i + 1]), method="bounded"
        )
        if refined.fun < objectives[i]:
            extension = float(refined.x)
    objective, alpha = best(extension)
    u = largest + extension
    ridge = np.asarray(extensions), objectives, alphas
    return GaussianFit(alpha, u, extension, objective, at_end, *ridge)


def fit_gaussian(
    recorded_mean: np.ndarray,
    recorded_covariance: np.ndarray,
    nominal_mean: np.ndarray,
    step_norm: np.ndarray,
    inverse_norm: np.ndarray,
    *,
    rows: int,
    beta1: float,
    extensions: np.ndarray,
) -> GaussianFit:
    """Minimise F = Σ_k β₁‖q̲_k − q̲̃_k‖ + β₂|tr{Cov(q_k) − Cov(q̃_k)}| over ũ in the range of
    ``extensions`` and all α ≥ 0, β₂ = 1 − β₁.

    Eq. (objective-u-alpha), with u = max_k ‖J̲_k⁺‖_F + ũ of Eq. (bound-u). The moments are of one
    step. The model's mean is the nominal one for every (ũ, α), so the first term, from
    ``nominal_mean`` and ``recorded_mean`` (M, n) in rad, is a constant. The model's trace is α²g_k,
    g_k = (u² − ‖J̲_k⁺‖²)‖v_k‖²/m, with ``step_norm`` ‖v_k‖ and ``inverse_norm`` ‖J̲_k⁺‖_F (M,), m =
    ``rows`` of the task; ``recorded_covariance`` (M, n, n) in rad². The absolute value, step by
    step, mends the printed objective, which falls without bound as the model's noise vanishes. In
    α² it is a weighted sum of distances: its minimum is the median of tr Cov(q̃_k)/g_k under the
    weights g_k. Over ũ it is searched on ``extensions`` (G ≥ 3, ascending, positive; the paper's ũ
    > 0 has no upper end, here the interval is the caller's to state) and refined between the
    neighbours of the best.

    Raises ModelDomainError for β₁ outside [0, 1), bad extensions, or a motion at rest throughout.
    """
    if not 0 <= beta1 < 1:
        raise ModelDomainError(
            "beta1 must lie in [0, 1): with beta1 = 1 the objective does not depend on the noise",
            beta1=beta1,
        )
    if len(extensions) < 3 or not extensions[0] > 0 or not np.all(np.diff(extensions) > 0):
        raise ModelDomainError(
            "the extensions of u must be at least three, positive and ascending",
            extensions=np.asarray(extensions).tolist(),
        )
    moving = step_norm > 0
    if not np.any(moving):
        raise ModelDomainError(
            "the motion is at rest at every step: alpha and u have no effect to fit"
        )
    traces = np.trace(recorded_covariance, axis1=-2, axis2=-1)
    largest = float(inverse_norm.max())
    constant = beta1 * np.linalg.norm(nominal_mean - recorded_mean, axis=-1).sum()

    def best(extension: float) -> tuple[float, float]:
        gain = ((largest + extension) ** 2 - inverse_norm**2) * step_norm**2 / rows
        alpha_squared = weighted_median(traces[moving] / gain[moving], gain[moving])
        return float(constant + (1 - beta1) * np.abs(alpha_squared * gain - traces).sum()), float(
            np.sqrt(alpha_squared)
        )

    return search(best, extensions, largest)
