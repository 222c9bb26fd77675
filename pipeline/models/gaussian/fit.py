"""(α, u) of the Gaussian matrix model: options, estimators (moments, the paper's distance of
moments, maximum likelihood), and the ridge of the objective over (α, u).

Every objective is minimised in α for every u = max ‖J̲⁺‖_F + ũ, Eq. (bound-u). The trace of a
step's covariance is α²g_k, g_k = (u² − ‖J̲_k⁺‖²)‖v_k‖²/m. If ‖J̲⁺‖ varies little over the motion,
the data determine only the noise level L = α√(u² − ⟨‖J̲⁺‖²⟩), ⟨⟩ weighted by ‖v_k‖², and neither α
nor αu. The data determine u if the minimum is inside the searched interval.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
import pandas as pd
from numpy import ndarray
from numpy.random import Generator
from pydantic import Field

from pipeline.core import validation
from pipeline.core.errors import ModelDomainError
from pipeline.models import steps as base
from pipeline.models.gaussian.law import noise_scale
from pipeline.models.model import axis_log_density, frobenius, principal_axes, task_step
from pipeline.models.steps import Estimate, Recorded, Truth
from pipeline.statistics.takes import takes_moments

EXTENSIONS = np.linspace(0.005, 1.0, 200)  # grid of ũ divided by the greatest ‖J̲⁺‖
LIKELY_EXTENSIONS = np.geomspace(0.005, 1.0, 25)  # grid of the likelihood
BOUND = 1.1  # u of :func:`truths` divided by the greatest norm ‖J⁺‖
# α is searched from 1/30 to 30 times the value of the second moments
ALPHA_RANGE = 30.0
TOLERANCE = 1e-4  # of ln α
# half width and points of the grid of ln α for a take's likelihood
REACH = 0.4
NODES = 9
RMS_NORM = "rms_norm_of_the_inverse_jacobian"
Estimator = Literal["moments", "paper", "likelihood"]
# ũ (G,) → least objectives, their α
Best = Callable[[ndarray], tuple[ndarray, ndarray]]


@validation.options(kw_only=True)
class Options(base.Options):
    """``estimator``: ``moments`` (total variance, then the variance by step), ``paper`` (distance
    of the one-step moments) or ``likelihood``.
    """

    estimator: Estimator = "moments"
    # β₁, weight of the mean's error in ``paper``
    beta: Annotated[float, Field(ge=0, lt=1)] = 0.5


class GaussianFit(NamedTuple):
    """Optimum, and ridge: least ``objectives`` (G,) and ``alphas`` at ``extensions`` (G,)."""

    alpha: float
    u: float  # û = max_k ‖J̲_k⁺‖_F + ũ
    extension: float  # ũ > 0
    objective: float  # least value: rad⁴ (moments), rad and rad² (paper) or −Σ ln p
    at_end: bool  # True if ũ is at an end of its interval: not determined
    unbounded: bool  # True at the upper end: a greater u fits as well
    extensions: ndarray
    objectives: ndarray
    alphas: ndarray


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """Estimate (α, u) by the estimator of ``options``; raises ModelDomainError for a motion at rest
    at every step.
    """
    squares = _square_speeds(recorded)
    if not np.any(squares):
        message = "the motion is at rest at every step: alpha and u cannot be estimated"
        raise ModelDomainError(message)
    if options.estimator == "paper":
        fit, mean_square = _fit_distance(recorded, squares, options.beta)
        from_takes = None
    else:
        fit, mean_square, from_takes = _fit_takes(recorded, squares, options.estimator)
    diagnostics = {
        "u_unbounded": int(fit.unbounded),
        "extension_of_the_norm": fit.extension,
        "greatest_norm_of_the_inverse_jacobian": fit.u - fit.extension,
        RMS_NORM: np.sqrt(mean_square),
        "objective": fit.objective,
        "extension_at_the_end_of_its_interval": fit.at_end,
    }
    parameters = {
        "kind": "gaussian",
        "alpha": fit.alpha,
        "u": fit.u,
        "u_unbounded": fit.unbounded,
    }
    return Estimate(
        parameters=parameters,
        estimates=_values(fit.alpha, fit.u, mean_square),
        diagnostics=diagnostics,
        details=fit,
        from_takes=from_takes,
        undetermined=("u", "alpha") if fit.at_end else (),
    )


def _fit_distance(
    recorded: Recorded,
    squares: ndarray,
    beta: float,
) -> tuple[GaussianFit, float]:
    """Return the fit of the paper's estimator, and ⟨‖J̲⁺‖²⟩ at the mean poses."""
    poses = recorded.q.mean(axis=0)
    norms = frobenius(recorded.chain.inverse_jacobian(poses, what="mean pose"))
    # root mean square over the commands (takes, M, m) of a closed loop
    speeds = np.sqrt(squares.reshape(-1, squares.shape[-1]).mean(axis=0))
    rows = len(recorded.chain.task)
    extensions = EXTENSIONS * norms.max()
    moments = takes_moments(recorded.noise)
    fit = fit_distance(moments, speeds, norms, rows, beta, extensions)
    return fit, _mean_square(norms**2, squares)


def _fit_takes(
    recorded: Recorded,
    squares: ndarray,
    estimator: Estimator,
) -> tuple[GaussianFit, float, Callable[[ndarray], dict[str, float]]]:
    """Return the fit by ``moments`` or ``likelihood``, ⟨‖J⁺‖²⟩ at the measured poses, and a
    function of take indices that returns the estimates of these takes.
    """
    norms = frobenius(recorded.chain.inverse_jacobian(recorded.q))
    speeds = np.broadcast_to(squares / len(recorded.chain.task), norms.shape)
    weighed = norms**2 * speeds
    every_take = np.arange(len(recorded.q))

    def mean_square_of(takes: ndarray) -> float:
        return float(weighed[takes].mean() / speeds[takes].mean())

    if estimator == "moments":
        optimum = fit_moments(recorded, speeds, norms)
        fit = optimum(every_take)
    else:
        fit, optimum = fit_likelihood(recorded)

    def from_takes(takes: ndarray) -> dict[str, float]:
        alpha, u = optimum(takes)[:2]
        return _values(alpha, u, mean_square_of(takes))

    return fit, mean_square_of(every_take), from_takes


def estimator_options(options: Options) -> dict[str, Options]:
    """Options of every estimator."""
    return {
        f"{{}}_{estimator}": replace(options, estimator=estimator)
        for estimator in get_args(Estimator)
    }


def truths(
    recorded: Recorded,
    options: Options,
    dispersions: Sequence[float],
) -> list[Truth]:
    """Return (α, u) with the recorded mean variance as the known parameters."""
    squares = frobenius(recorded.chain.inverse_jacobian(recorded.q)) ** 2
    speeds = _square_speeds(recorded)
    m = len(recorded.chain.task)
    total_variance = np.trace(base.mean_covariance(recorded.noise))
    u = BOUND * float(np.sqrt(squares.max()))
    alpha = float(np.sqrt(m * total_variance / np.mean((u**2 - squares) * speeds)))
    values = _values(alpha, u, _mean_square(squares, speeds))
    return [Truth("gaussian", {"kind": "gaussian", "alpha": alpha, "u": u}, values)]


def _square_speeds(recorded: Recorded) -> ndarray:
    """(..., M) ‖v_k‖²."""
    v = task_step(recorded.chain, recorded.v)
    return np.vecdot(v, v)


def _mean_square(squares: ndarray, speeds: ndarray) -> float:
    """⟨‖J⁺‖²⟩ of ``squares`` (..., M), weighted by the squared commanded steps (..., M)."""
    squares, weights = np.broadcast_arrays(squares, speeds)
    return np.average(squares, weights=weights)


def _values(alpha: float, u: float, mean_square: float) -> dict[str, float]:
    """Estimates by name; noise_level²·‖v‖²/m is the mean variance of the noise."""
    return {"u": u, "alpha": alpha, "noise_level": alpha * np.sqrt(u**2 - mean_square)}


def diagnose(
    recorded: Recorded,
    options: Options,
    estimate: Estimate | None,
    checks: int,
    rng: Generator,
) -> tuple[dict[str, float], dict[str, pd.DataFrame]]:
    """Greatest relative difference between Σ_k and the solution of the log-det problem as printed,
    at ``checks`` evenly spaced steps; and the table ``ridge``.
    """
    if estimate is None:
        return {}, {}
    from pipeline.models.convex import (
        noise_covariance_gap,  # here: CVXPY imports slowly
    )

    fit = estimate.details
    mean_square = estimate.diagnostics[RMS_NORM] ** 2
    inverse = recorded.chain.inverse_jacobian(recorded.q.mean(axis=0))
    norms = frobenius(inverse)
    places = np.linspace(0, len(norms) - 1, min(checks, len(norms))).astype(int)
    shape = inverse.shape[-2:]
    metrics = {
        "convex_problems_checked": len(places),
        "convex_check_greatest_relative_gap": noise_covariance_gap(
            norms[places],
            fit.alpha,
            fit.u,
            *shape,
        ),
    }
    u = fit.u - fit.extension + fit.extensions
    least = min(fit.objective, fit.objectives.min())
    ridge = {
        "u": u,
        "alpha": fit.alphas,
        "level": fit.alphas * np.sqrt(u**2 - mean_square),
        "excess": fit.objectives - least,
    }
    return metrics, {"ridge": pd.DataFrame(ridge)}


def _search(best: Best, extensions: ndarray, largest: float) -> GaussianFit:
    """Minimise over the grid ``extensions`` ũ (G ≥ 3,), then between its best neighbours."""
    from scipy.optimize import minimize_scalar

    objectives, alphas = best(extensions)
    i = int(objectives.argmin())
    last = len(extensions) - 1
    extension = float(extensions[i])
    alpha = float(alphas[i])
    objective = float(objectives[i])
    if 0 < i < last:
        refined = minimize_scalar(
            lambda x: float(best(np.array([x]))[0][0]),
            bounds=(extensions[i - 1], extensions[i + 1]),
            method="bounded",
        )
        if refined.fun < objective:
            extension = float(refined.x)
            least, alpha_at_least = best(np.array([extension]))
            objective = float(least[0])
            alpha = float(alpha_at_least[0])
    return GaussianFit(
        alpha=alpha,
        u=largest + extension,
        extension=extension,
        objective=objective,
        at_end=i in (0, last),
        unbounded=i == last,
        extensions=extensions,
        objectives=objectives,
        alphas=alphas,
    )


def fit_moments(
    recorded: Recorded,
    speeds: ndarray,
    norms: ndarray,
) -> Callable[[ndarray], GaussianFit]:
    """Return the estimator by moments as a function of take indices.

    α follows from the recorded total variance for every u = max ‖J⁺‖·(1 + EXTENSIONS). û minimises
    Σ_k (α²g_k − t_k)² in rad⁴, t_k the trace of the sample covariance of ω at step k minus tr Σ_m.
    ``speeds`` ‖v‖²/m and ``norms`` ‖J⁺‖_F are (takes, M).
    """
    variances = base.take_variances(recorded)
    every = norms**2 * speeds
    largest = float(np.sqrt((norms**2)[speeds > 0].max()))

    def of_takes(takes: ndarray) -> GaussianFit:
        speed = speeds[takes].mean(axis=0)
        weighed = every[takes].mean(axis=0)
        traces, measured = variances(takes)
        traces = traces - measured

        def best(extensions: ndarray) -> tuple[ndarray, ndarray]:
            u = largest + extensions[:, None]
            gain = u**2 * speed - weighed
            alpha_squared = traces.mean() / gain.mean(axis=1)
            error = alpha_squared[:, None] * gain - traces
            objective = np.vecdot(error, error)
            return objective, np.sqrt(alpha_squared)

        return _search(best, largest * EXTENSIONS, largest)

    return of_takes


def fit_distance(
    moments: tuple[ndarray, ndarray],
    speeds: ndarray,
    norms: ndarray,
    rows: int,
    beta1: float,
    extensions: ndarray,
) -> GaussianFit:
    """Minimise F = Σ_k β₁‖q̲_k − q̲̃_k‖ + β₂|tr{Cov(q_k) − Cov(q̃_k)}| over ũ in the range of
    ``extensions`` and all α ≥ 0, β₂ = 1 − β₁: Eqs. (bound-u) and (objective-u-alpha).

    ``moments`` are the recorded mean (M, n) in rad, relative to the nominal step, and covariance
    (M, n, n) in rad² of one step, ``speeds`` ‖v_k‖ and ``norms`` ‖J̲_k⁺‖_F (M,), ``rows`` m. The
    model's mean is the nominal step, so the first term is a constant. The absolute value corrects
    the printed objective, whose minimum is α = 0. The optimal α² is the median of tr Cov(q̃_k)/g_k
    with the weights g_k.
    """
    mean, covariance = moments
    moving = speeds > 0
    largest = float(norms.max())
    traces = np.trace(covariance, axis1=-2, axis2=-1)
    constant = beta1 * np.linalg.norm(mean, axis=-1).sum()

    def best(extensions: ndarray) -> tuple[ndarray, ndarray]:
        u = largest + extensions[:, None]
        gain = (u**2 - norms**2) * speeds**2 / rows
        weights = gain[:, moving]
        squared = _weighted_medians(traces[moving] / weights, weights)
        distance = np.abs(squared * gain - traces).sum(axis=1)
        objective = constant + (1 - beta1) * distance
        return objective, np.sqrt(squared[:, 0])

    return _search(best, extensions, largest)


def _weighted_medians(values: ndarray, weights: ndarray) -> ndarray:
    """(G, 1) medians of the rows of ``values`` (G, M) with ``weights`` (G, M)."""
    order = np.argsort(values, axis=1, kind="stable")
    sorted_weights = np.take_along_axis(weights, order, 1)
    below = np.cumsum(sorted_weights, axis=1)
    half = below[:, -1:] / 2
    place = (below < half).sum(axis=1, keepdims=True)
    middle = np.take_along_axis(order, place, 1)
    return np.take_along_axis(values, middle, 1)


def fit_likelihood(
    recorded: Recorded,
) -> tuple[GaussianFit, Callable[[ndarray], tuple]]:
    """Maximum-likelihood (α̂, û) of the steps with a command, and a function of take indices that
    returns their (α̂, û). The density of a step plus measurement noise is exact; u is on the grid
    max ‖J⁺‖_F·(1 + LIKELY_EXTENSIONS). Raises SingularJacobianError, ModelDomainError.
    """

    least, axes = principal_axes(recorded.measurement)
    q, v, noise = base.moving_steps(recorded)
    inverse = recorded.chain.inverse_jacobian(q)
    v = task_step(recorded.chain, v)
    norms = frobenius(inverse)
    speeds = np.vecdot(v, v)
    takes = len(recorded.q)
    largest = float(norms.max())
    squared = float(np.mean(noise**2))
    squares = (noise @ axes) ** 2  # along the principal axes of Σ_m

    def gain_at(extension: float) -> ndarray:
        u = largest * (1 + extension)
        return noise_scale(norms, 1.0, u, *inverse.shape[-2:]) * speeds

    def densities(log_alpha: float, gain: ndarray) -> ndarray:
        variances = (np.exp(2 * log_alpha) * gain)[:, None] + least
        return axis_log_density(squares, variances)

    def best(extensions: ndarray) -> tuple[ndarray, ndarray]:
        objectives, alphas = np.empty((2, len(extensions)))
        for i, extension in enumerate(extensions):
            gain = gain_at(float(extension))
            middle = 0.5 * np.log(squared / gain.mean())
            objectives[i], alphas[i] = _least(partial(densities, gain=gain), middle)
        return objectives, alphas

    fit = _search(best, LIKELY_EXTENSIONS, 1.0)
    # −Σ ln p of the moving steps of each take, at NODES of ln α for each extension of u
    log_alphas = np.log(fit.alphas)[:, None] + np.linspace(-REACH, REACH, NODES)
    costs = np.empty((takes, *log_alphas.shape))
    for i, extension in enumerate(fit.extensions):
        gain = gain_at(float(extension))
        for j, log_alpha in enumerate(log_alphas[i]):
            by_take = densities(log_alpha, gain).reshape(takes, -1)
            costs[:, i, j] = -by_take.sum(axis=1)
    fit = fit._replace(
        u=largest * fit.u,
        extension=largest * fit.extension,
        extensions=largest * fit.extensions,
    )
    return fit, partial(_optimum_of_takes, fit, log_alphas, costs)


def _least(densities: Callable[[float], ndarray], middle: float) -> tuple[float, float]:
    """Return the least −Σ ln p over ln α about ``middle``, and its α."""
    from scipy.optimize import minimize_scalar

    reach = np.log(ALPHA_RANGE)
    result = minimize_scalar(
        lambda log_alpha: -float(densities(log_alpha).sum()),
        bounds=(middle - reach, middle + reach),
        method="bounded",
        options={"xatol": TOLERANCE},
    )
    return float(result.fun), float(np.exp(result.x))


def _optimum_of_takes(
    fit: GaussianFit,
    log_alphas: ndarray,
    costs: ndarray,
    takes: ndarray,
) -> tuple[float, float]:
    """Return (α̂, û) of the ``takes`` by parabolas through −Σ ln p, ``costs`` (takes, G, NODES) at
    ``log_alphas`` (G, NODES). Raises ModelDomainError for an optimum at an end of the nodes.
    """
    cost = costs[takes].sum(axis=0)
    optima, lowest = np.empty((2, len(cost)))
    for i, row in enumerate(cost):
        optima[i], lowest[i] = _vertex(log_alphas[i], row)
    i = int(lowest.argmin())
    last = len(lowest) - 1
    if np.isnan(optima[i]):
        message = (
            "the maximum of these takes' likelihood is outside the evaluated range"
        )
        raise ModelDomainError(message, takes=takes.tolist())
    extension = fit.extensions[i]
    if 0 < i < last:
        near = slice(i - 1, i + 2)
        extension, _ = _vertex(fit.extensions[near], lowest[near])
    alpha = np.exp(np.interp(extension, fit.extensions, optima))
    return float(alpha), float(fit.u - fit.extension + extension)


def _vertex(x: ndarray, y: ndarray) -> tuple[float, float]:
    """Vertex of the parabola through the least of ``y`` and its neighbours; x is NaN at an end."""
    i = int(y.argmin())
    if i in (0, len(y) - 1):
        return np.nan, float(y[i])
    near = slice(i - 1, i + 2)
    offsets = x[near] - x[i]
    a, b, c = np.polyfit(offsets, y[near], 2)
    place = x[i] - b / (2 * a)
    least = c - b**2 / (4 * a)
    return float(place), float(least)
