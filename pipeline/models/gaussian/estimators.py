"""Estimators of (α, u) of the Gaussian matrix model: by moments, by the paper's distance of
moments, and most likely. Each is minimised in α for every u = max ‖J̲⁺‖_F + ũ, Eq. (bound-u).

The trace of a step's covariance is α²g_k, g_k = (u² − ‖J̲_k⁺‖²)‖v_k‖²/m, so that α and u are hardly
told apart: where ‖J̲⁺‖ varies little over the motion, αu alone matters. The data determine u only
where the objective is least inside the interval that is searched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.gaussian.law import noise_scale
from pipeline.models.model import frobenius, task_step
from pipeline.models.normal import axis_log_density, principal_axes
from pipeline.models.steps import Recorded, TakeVariances, moving_steps

ALPHA_RANGE = 30.0  # α is sought within this factor of what the second moments suggest
TOLERANCE = 1e-4  # of ln α
# of ln α about the most likely, on either side, and its nodes: where the likelihood of each take is
# kept for resampling
REACH, NODES = 0.4, 9


class GaussianFit(NamedTuple):
    """The optimum, and the ridge it lies on: for each of ``extensions`` (G,) the least
    ``objectives`` (G,) and its ``alphas`` (G,).
    """

    alpha: float
    u: float  # û = max_k ‖J̲_k⁺‖_F + ũ
    extension: float  # ũ > 0
    objective: float  # least value: rad⁴, rad and rad² mixed as in the paper, or −Σ ln p
    at_end: bool  # True where ũ stopped at an end of its interval, so that nothing determines it
    unbounded: bool  # True at the upper end: a greater u would do as well
    extensions: np.ndarray
    objectives: np.ndarray
    alphas: np.ndarray


# extensions (G,) → the least objective (G,) at each and its α (G,)
Best = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def search(best: Best, extensions: np.ndarray, largest: float) -> GaussianFit:
    """The best of ``extensions`` ũ (G ≥ 3,), ascending and positive, of the ``largest`` norm, and
    between its neighbours; raises ModelDomainError for other extensions.
    """
    from scipy.optimize import minimize_scalar

    extensions = np.asarray(extensions, dtype=float)
    if len(extensions) < 3 or not extensions[0] > 0 or not np.all(np.diff(extensions) > 0):
        message = "the extensions of u must be at least three, positive and ascending"
        raise ModelDomainError(message, extensions=extensions.tolist())
    objectives, alphas = best(extensions)
    i, last = int(objectives.argmin()), len(extensions) - 1
    extension, objective, alpha = (float(each[i]) for each in (extensions, objectives, alphas))
    if 0 < i < last:
        refined = minimize_scalar(
            lambda x: float(best(np.array([x]))[0][0]),
            bounds=(extensions[i - 1], extensions[i + 1]),
            method="bounded",
        )
        if refined.fun < objective:
            extension = float(refined.x)
            objective, alpha = (float(each[0]) for each in best(np.array([extension])))
    optimum = alpha, largest + extension, extension, objective, i in (0, last), i == last
    return GaussianFit(*optimum, extensions, objectives, alphas)


@dataclass(frozen=True)
class StepMeans:
    """Squared speeds and norms of each step, of which the variance of its noise is made."""

    speeds: np.ndarray  # (takes, M) ‖v‖²/m
    norms: np.ndarray  # (takes, M) ‖J⁺‖²‖v‖²/m
    largest: float  # ‖J⁺‖_F over all moving steps
    variances: TakeVariances

    @classmethod
    def of(cls, recorded: Recorded) -> StepMeans:
        """Build from the steps of ``recorded``; raises SingularJacobianError, and ModelDomainError
        for a motion at rest throughout and where the measurement noise is not known.
        """
        squares = frobenius(recorded.chain.inverse_jacobian(recorded.q)) ** 2
        v = task_step(recorded.chain, recorded.v)
        speeds = np.broadcast_to(np.vecdot(v, v) / v.shape[-1], squares.shape)
        require_motion(speeds)
        largest = float(np.sqrt(squares[speeds > 0].max()))
        return cls(speeds, squares * speeds, largest, TakeVariances.of(recorded))

    def mean_square(self, takes: np.ndarray) -> float:
        """⟨‖J⁺‖²⟩ of the ``takes``, weighed by the squares of the commanded steps."""
        return float(self.norms[takes].mean() / self.speeds[takes].mean())

    def fit(self, extensions: np.ndarray, takes: np.ndarray) -> GaussianFit:
        """(α̂, û) by moments: for every u = ``largest``·(1 + extension) the α of the recorded total
        variance of the ``takes``, and of these the u of the variance's course over time.

        Minimised is Σ_k (α²g_k − t_k)² in rad⁴, t_k the trace of the sample covariance of ω at step
        k less that of the measurement noise, under mean α²g_k = mean t_k. Raises ModelDomainError
        where the recorded variance is not above that of the measurement noise.
        """
        speeds, norms = self.speeds[takes].mean(axis=0), self.norms[takes].mean(axis=0)
        traces, measured = self.variances.of_motion(takes)
        traces = traces - measured

        def best(extensions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            gain = (self.largest + extensions[:, None]) ** 2 * speeds - norms
            squared = traces.mean() / gain.mean(axis=1)
            error = squared[:, None] * gain - traces
            return np.vecdot(error, error), np.sqrt(squared)

        return search(best, self.largest * np.asarray(extensions), self.largest)


def require_motion(speeds: np.ndarray) -> None:
    """Raise ModelDomainError where all ``speeds`` are zero."""
    if not np.any(speeds):
        raise ModelDomainError(
            "the motion is at rest at every step: alpha and u have no effect to fit"
        )


def fit_distance(
    mean: np.ndarray,
    covariance: np.ndarray,
    speeds: np.ndarray,
    norms: np.ndarray,
    *,
    rows: int,
    beta1: float,
    extensions: np.ndarray,
) -> GaussianFit:
    """Minimise F = Σ_k β₁‖q̲_k − q̲̃_k‖ + β₂|tr{Cov(q_k) − Cov(q̃_k)}| over ũ in the range of
    ``extensions`` and all α ≥ 0, β₂ = 1 − β₁: Eqs. (bound-u) and (objective-u-alpha).

    The moments are of one step, ``mean`` (M, n) in rad about the nominal one, which is the model's
    for every (ũ, α), so that the first term is a constant, and ``covariance`` (M, n, n) in rad².
    ``speeds`` is ‖v_k‖ and ``norms`` ‖J̲_k⁺‖_F (M,), ``rows`` m of the task. The absolute value,
    step by step, mends the printed objective, which falls without bound as the model's noise
    vanishes. In α² the minimum is the median of tr Cov(q̃_k)/g_k under the weights g_k. The paper's
    ũ > 0 has no upper end; here the caller states the interval.

    Raises ModelDomainError for β₁ outside [0, 1), bad extensions, or a motion at rest throughout.
    """
    if not 0 <= beta1 < 1:
        message = "beta1 must lie in [0, 1): with beta1 = 1 the objective ignores the noise"
        raise ModelDomainError(message, beta1=beta1)
    require_motion(speeds)
    moving, largest = speeds > 0, float(norms.max())
    traces = np.trace(covariance, axis1=-2, axis2=-1)
    constant = beta1 * np.linalg.norm(mean, axis=-1).sum()

    def best(extensions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gain = ((largest + extensions[:, None]) ** 2 - norms**2) * speeds**2 / rows
        ratios, weights = traces[moving] / gain[:, moving], gain[:, moving]
        order = np.argsort(ratios, axis=1, kind="stable")
        below = np.cumsum(np.take_along_axis(weights, order, 1), axis=1)
        median = (below < below[:, -1:] / 2).sum(axis=1, keepdims=True)
        squared = np.take_along_axis(ratios, np.take_along_axis(order, median, 1), 1)
        distance = np.abs(squared * gain - traces).sum(axis=1)
        return constant + (1 - beta1) * distance, np.sqrt(squared[:, 0])

    return search(best, extensions, largest)


class GaussianLikelihood(NamedTuple):
    """−Σ ln p of the moving steps of each take, at NODES of ln α for each extension of u."""

    fit: GaussianFit
    log_alphas: np.ndarray  # (G, NODES) ascending
    costs: np.ndarray  # (takes, G, NODES)

    def from_takes(self, takes: np.ndarray) -> tuple[float, float]:
        """(α̂, û) of the takes with these numbers, as often as each is named, by parabolas through
        the nodes; raises ModelDomainError where they are beyond the nodes.
        """
        fit, costs = self.fit, self.costs[takes].sum(axis=0)
        vertices = [_vertex(x, y) for x, y in zip(self.log_alphas, costs, strict=True)]
        log_alphas, least = np.array(vertices).T
        i, last = int(least.argmin()), len(least) - 1
        if np.isnan(log_alphas[i]):
            raise ModelDomainError(
                "the likelihood of these takes is greatest beyond where it was evaluated",
                takes=takes.tolist(),
            )
        extension = fit.extensions[i]
        if 0 < i < last:
            near = slice(i - 1, i + 2)
            extension = _vertex(fit.extensions[near], least[near])[0]
        alpha = np.exp(np.interp(extension, fit.extensions, log_alphas))
        return float(alpha), float(fit.u - fit.extension + extension)


def _vertex(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Argument and value at the vertex of the parabola through the least of ``y`` (N,) at ``x``
    (N,) and its neighbours; NaN for the argument where the least is at an end.
    """
    i = int(y.argmin())
    if i in (0, len(y) - 1):
        return np.nan, float(y[i])
    a, b, c = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
    return float(x[i] - b / (2 * a)), float(c - b**2 / (4 * a))


def fit_likelihood(recorded: Recorded, extensions: np.ndarray) -> GaussianLikelihood:
    """(α̂, û) of greatest likelihood of the steps with a command, p the exact density of a step plus
    the measurement noise, without which the slowest steps would decide.

    u = max ‖J⁺‖_F·(1 + extension), over all recorded poses with a command, so that none is beyond
    the bound; ``extensions`` (G ≥ 3,) are ascending and positive. ``objective`` of the fit is
    −Σ ln p. Raises SingularJacobianError and ModelDomainError.
    """
    from scipy.optimize import minimize_scalar

    least, axes = principal_axes(recorded.measurement)
    q, v, noise = moving_steps(recorded.q, recorded.v, recorded.noise)
    inverse, v = recorded.chain.inverse_jacobian(q), task_step(recorded.chain, v)
    norms, speeds = frobenius(inverse), np.vecdot(v, v)
    largest, squared, reach = float(norms.max()), float(np.mean(noise**2)), np.log(ALPHA_RANGE)
    parts = (noise @ axes) ** 2  # along the axes of Σ_m, which every α leaves as they are

    def gain_at(extension: float) -> np.ndarray:
        return noise_scale(norms, 1.0, largest * (1 + extension), *inverse.shape[-2:]) * speeds

    def densities(log_alpha: float, gain: np.ndarray) -> np.ndarray:
        return axis_log_density(parts, (np.exp(2 * log_alpha) * gain)[:, None] + least)

    def best_at(extension: float) -> tuple[float, float]:
        gain = gain_at(extension)
        middle = 0.5 * np.log(squared / gain.mean())
        result = minimize_scalar(
            lambda log_alpha: -float(densities(log_alpha, gain).sum()),
            bounds=(middle - reach, middle + reach),
            method="bounded",
            options={"xatol": TOLERANCE},
        )
        return float(result.fun), float(np.exp(result.x))

    def best(extensions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return tuple(np.array([best_at(float(each)) for each in extensions]).T)

    fit = search(best, extensions, 1.0)
    log_alphas = np.log(fit.alphas)[:, None] + np.linspace(-REACH, REACH, NODES)
    costs = np.empty((len(recorded.q), *log_alphas.shape))
    for i, extension in enumerate(fit.extensions):
        gain = gain_at(float(extension))
        for j, log_alpha in enumerate(log_alphas[i]):
            costs[:, i, j] = -densities(log_alpha, gain).reshape(len(costs), -1).sum(axis=1)
    scaled = {name: largest * getattr(fit, name) for name in ("u", "extension", "extensions")}
    return GaussianLikelihood(fit._replace(**scaled), log_alphas, costs)
