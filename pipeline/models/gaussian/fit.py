"""(α, u) of the Gaussian matrix model: options, estimators by moments, by the paper's distance of
moments and by maximum likelihood, and what is looked at beside them: the ridge that (α, u) lie on,
and the gap of Σ_k to the problem as printed.

Each estimator is minimised in α for every u = max ‖J̲⁺‖_F + ũ, Eq. (bound-u). The trace of a step's
covariance is α²g_k, g_k = (u² − ‖J̲_k⁺‖²)‖v_k‖²/m: where ‖J̲⁺‖ varies little over the motion, αu
alone matters. The data determine u only where the objective is least inside the interval.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
import pandas as pd
from numpy.random import Generator
from pydantic import Field

from pipeline.core import validation
from pipeline.core.errors import ModelDomainError
from pipeline.models import options as base
from pipeline.models.gaussian.law import noise_scale
from pipeline.models.model import frobenius, task_step
from pipeline.models.noise import mean_covariance
from pipeline.models.normal import axis_log_density, principal_axes
from pipeline.models.steps import Estimate, Examined, Recorded, TakeVariances, Truth, moving_steps
from pipeline.statistics.takes import takes_moments

EXTENSIONS = np.linspace(0.005, 1.0, 200)  # ũ tried, as shares of the greatest ‖J̲⁺‖
LIKELY_EXTENSIONS = np.geomspace(0.005, 1.0, 25)  # where α has to be searched at each
BOUND = 1.1  # u of known parameters over the greatest norm of the poses: within what is searched
ALPHA_RANGE = 30.0  # α is sought within this factor of what the second moments suggest
TOLERANCE = 1e-4  # of ln α
REACH, NODES = 0.4, 9  # of ln α about the most likely, where each take's likelihood is kept
Estimator = Literal["moments", "paper", "likelihood"]


@validation.options(kw_only=True)
class Options(base.Options):
    """``estimator``: ``moments`` (the recorded total variance, then its course over time),
    ``paper`` (the distance of one-step moments, step by step) or ``likelihood``.
    """

    estimator: Estimator = "moments"
    # of the paper's estimator alone: β₁, weight of the mean's error
    beta: Annotated[float, Field(ge=0, lt=1)] = 0.5


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """(α, u) by the estimator of ``options``; ModelDomainError for a motion at rest throughout."""
    squares = _square_speeds(recorded)
    if not np.any(squares):
        message = "the motion is at rest at every step: alpha and u have no effect to fit"
        raise ModelDomainError(message)
    if options.estimator == "paper":
        poses = recorded.q.mean(axis=0)
        norms = frobenius(recorded.chain.inverse_jacobian(poses, what="mean pose"))
        # of the commands (takes, M, m) of a closed loop the root mean square
        speeds = np.sqrt(squares.reshape(-1, squares.shape[-1]).mean(axis=0))
        steps = *takes_moments(recorded.noise), speeds, norms, len(recorded.chain.task)
        fit = fit_distance(*steps, options.beta, EXTENSIONS * norms.max())
        return _estimate(fit, _mean_square(norms**2, squares))
    means, takes = StepMeans.of(recorded), np.arange(len(recorded.q))
    if options.estimator == "moments":
        fit, from_takes = means.fit(takes), means.fit
    else:
        likelihood = fit_likelihood(recorded)
        fit, from_takes = likelihood.fit, likelihood.from_takes
    return _estimate(fit, means.mean_square(takes), partial(_of_takes, means, from_takes))


def _of_takes(means: StepMeans, from_takes: Callable, takes: np.ndarray) -> dict[str, float]:
    alpha, u = from_takes(takes)[:2]
    return _values(alpha, u, means.mean_square(takes))


def compared(options: Options) -> dict[str, Options]:
    """Every estimator."""
    return {f"{{}}_{each}": replace(options, estimator=each) for each in get_args(Estimator)}


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """(α, u) of the recorded mean variance; ``options`` and ``dispersions`` do not matter."""
    squares = frobenius(recorded.chain.inverse_jacobian(recorded.q)) ** 2
    speeds, m = _square_speeds(recorded), len(recorded.chain.task)
    total_variance = np.trace(mean_covariance(recorded.noise))
    u = BOUND * float(np.sqrt(squares.max()))
    alpha = float(np.sqrt(m * total_variance / np.mean((u**2 - squares) * speeds)))
    values = _values(alpha, u, _mean_square(squares, speeds))
    return [Truth("gaussian", {"kind": "gaussian", "alpha": alpha, "u": u}, values)]


def _square_speeds(recorded: Recorded) -> np.ndarray:
    """(..., M) ‖v_k‖²."""
    v = task_step(recorded.chain, recorded.v)
    return np.vecdot(v, v)


def _mean_square(squares: np.ndarray, speeds: np.ndarray) -> float:
    """⟨‖J⁺‖²⟩ of ``squares`` (..., M), weighed by the square of the commanded steps (..., M)."""
    squares, weights = np.broadcast_arrays(squares, speeds)
    return np.average(squares, weights=weights)


def _values(alpha: float, u: float, mean_square: float) -> dict[str, float]:
    """α·sqrt(u² − ⟨‖J⁺‖²⟩) is told well, as its square times ‖v‖² is the noise's mean variance."""
    return {"u": u, "alpha": alpha, "noise_level": alpha * np.sqrt(u**2 - mean_square)}


def _estimate(fit: GaussianFit, mean_square: float, from_takes=None) -> Estimate:
    diagnostics = {
        "u_unbounded": int(fit.unbounded),
        "extension_of_the_norm": fit.extension,
        "greatest_norm_of_the_inverse_jacobian": fit.u - fit.extension,
        "rms_norm_of_the_inverse_jacobian": np.sqrt(mean_square),
        "objective": fit.objective,
        "extension_at_the_end_of_its_interval": fit.at_end,
    }
    parameters = {"kind": "gaussian", "alpha": fit.alpha, "u": fit.u, "u_unbounded": fit.unbounded}
    values, unsure = _values(fit.alpha, fit.u, mean_square), ("u", "alpha") if fit.at_end else ()
    return Estimate(parameters, values, diagnostics, fit, from_takes, unsure)


def examined(
    recorded: Recorded, options: Options, estimate: Estimate | None, checks: int, rng: Generator
) -> Examined:
    """The table ``ridge``, and the greatest gap between Σ_k and the solution of the log-det problem
    as printed, at ``checks`` of the steps, evenly spread.
    """
    if estimate is None:
        return {}, {}
    from pipeline.models.convex import noise_covariance_gap  # here, as CVXPY takes long to import

    fit = estimate.details
    inverse = recorded.chain.inverse_jacobian(recorded.q.mean(axis=0))
    norms = frobenius(inverse)
    checked = norms[np.linspace(0, len(norms) - 1, min(checks, len(norms))).astype(int)]
    gap = noise_covariance_gap(checked, fit.alpha, fit.u, *inverse.shape[-2:])
    metrics = {"convex_problems_checked": len(checked), "convex_check_greatest_relative_gap": gap}
    u, least = fit.u - fit.extension + fit.extensions, min(fit.objective, fit.objectives.min())
    mean_square = estimate.diagnostics["rms_norm_of_the_inverse_jacobian"] ** 2
    ridge = {"u": u, "alpha": fit.alphas, "level": fit.alphas * np.sqrt(u**2 - mean_square)}
    return metrics, {"ridge": pd.DataFrame(ridge | {"excess": fit.objectives - least})}


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


def _search(best: Callable, extensions: np.ndarray, largest: float) -> GaussianFit:
    """The best of ``extensions`` ũ (G ≥ 3,) of the ``largest`` norm, and between its neighbours;
    ``best`` gives the least objective (G,) at each and its α (G,).
    """
    from scipy.optimize import minimize_scalar

    objectives, alphas = best(extensions)
    i, last = int(objectives.argmin()), len(extensions) - 1
    extension, objective, alpha = (float(each[i]) for each in (extensions, objectives, alphas))
    if 0 < i < last:
        ends = extensions[i - 1], extensions[i + 1]
        refined = minimize_scalar(
            lambda x: float(best(np.array([x]))[0][0]), bounds=ends, method="bounded"
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
        """Raises SingularJacobianError, and ModelDomainError without a known measurement noise."""
        squares = frobenius(recorded.chain.inverse_jacobian(recorded.q)) ** 2
        v = task_step(recorded.chain, recorded.v)
        speeds = np.broadcast_to(np.vecdot(v, v) / v.shape[-1], squares.shape)
        largest = float(np.sqrt(squares[speeds > 0].max()))
        return cls(speeds, squares * speeds, largest, TakeVariances.of(recorded))

    def mean_square(self, takes: np.ndarray) -> float:
        """⟨‖J⁺‖²⟩ of the ``takes``, weighed by the squares of the commanded steps."""
        return float(self.norms[takes].mean() / self.speeds[takes].mean())

    def fit(self, takes: np.ndarray) -> GaussianFit:
        """(α̂, û) by moments: for every u = ``largest``·(1 + EXTENSIONS) the α of the recorded
        total variance of the ``takes``, and of these the u of the variance's course over time.

        Minimised is Σ_k (α²g_k − t_k)² in rad⁴, t_k the trace of the sample covariance of ω at step
        k less the measurement's, under mean α²g_k = mean t_k.
        """
        speeds, norms = self.speeds[takes].mean(axis=0), self.norms[takes].mean(axis=0)
        traces, measured = self.variances.of_motion(takes)
        traces = traces - measured

        def best(extensions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            gain = (self.largest + extensions[:, None]) ** 2 * speeds - norms
            squared = traces.mean() / gain.mean(axis=1)
            error = squared[:, None] * gain - traces
            return np.vecdot(error, error), np.sqrt(squared)

        return _search(best, self.largest * EXTENSIONS, self.largest)


def fit_distance(
    mean: np.ndarray,
    covariance: np.ndarray,
    speeds: np.ndarray,
    norms: np.ndarray,
    rows: int,
    beta1: float,
    extensions: np.ndarray,
) -> GaussianFit:
    """Minimise F = Σ_k β₁‖q̲_k − q̲̃_k‖ + β₂|tr{Cov(q_k) − Cov(q̃_k)}| over ũ in the range of
    ``extensions`` and all α ≥ 0, β₂ = 1 − β₁: Eqs. (bound-u) and (objective-u-alpha).

    The moments are of one step, ``mean`` (M, n) in rad about the nominal one, which is the model's
    for every (ũ, α), so that the first term is a constant, and ``covariance`` (M, n, n) in rad².
    ``speeds`` is ‖v_k‖ and ``norms`` ‖J̲_k⁺‖_F (M,), ``rows`` m. The absolute value, step by step,
    mends the printed objective, which falls without bound as the model's noise vanishes. In α² the
    minimum is the median of tr Cov(q̃_k)/g_k under the weights g_k.
    """
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

    return _search(best, extensions, largest)


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
            message = "the likelihood of these takes is greatest beyond where it was evaluated"
            raise ModelDomainError(message, takes=takes.tolist())
        extension = fit.extensions[i]
        if 0 < i < last:
            near = slice(i - 1, i + 2)
            extension = _vertex(fit.extensions[near], least[near])[0]
        alpha = np.exp(np.interp(extension, fit.extensions, log_alphas))
        return float(alpha), float(fit.u - fit.extension + extension)


def _vertex(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Vertex of the parabola through the least of ``y`` and its neighbours; at NaN for an end."""
    i = int(y.argmin())
    if i in (0, len(y) - 1):
        return np.nan, float(y[i])
    a, b, c = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
    return float(x[i] - b / (2 * a)), float(c - b**2 / (4 * a))


def fit_likelihood(recorded: Recorded) -> GaussianLikelihood:
    """(α̂, û) of greatest likelihood of the steps with a command, by the exact density of a step
    plus the measurement noise, without which the slowest steps would decide.

    u = max ‖J⁺‖_F·(1 + LIKELY_EXTENSIONS) over all poses with a command; ``objective`` is −Σ ln p.
    Raises SingularJacobianError and ModelDomainError.
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

    fit = _search(best, LIKELY_EXTENSIONS, 1.0)
    log_alphas = np.log(fit.alphas)[:, None] + np.linspace(-REACH, REACH, NODES)
    costs = np.empty((len(recorded.q), *log_alphas.shape))
    for i, extension in enumerate(fit.extensions):
        gain = gain_at(float(extension))
        for j, log_alpha in enumerate(log_alphas[i]):
            costs[:, i, j] = -densities(log_alpha, gain).reshape(len(costs), -1).sum(axis=1)
    scaled = {name: largest * getattr(fit, name) for name in ("u", "extension", "extensions")}
    return GaussianLikelihood(fit._replace(**scaled), log_alphas, costs)
