"""σ_B of the Wishart model: options, estimators (moments, the paper's convex problem at every step,
maximum likelihood), and σ̂_B as a function of α₂/α₁ and of the bound ε, which the paper does not
state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy import ndarray
from numpy.random import Generator
from pydantic import Field

from pipeline.core import validation
from pipeline.core.errors import ModelDomainError
from pipeline.models import steps as base
from pipeline.models.model import normal_log_density, task_step
from pipeline.models.steps import (
    Estimate,
    Recorded,
    Truth,
    moving_steps,
    take_variances,
)
from pipeline.models.wishart.decomposition import (
    CONTROL,
    Decomposition,
    decomposition_of,
    factors,
)
from pipeline.models.wishart.law import WishartModel, dispersion_of_trace, step_squares
from pipeline.randommatrix.wishart import (
    degrees_of_freedom,
    largest_dispersion,
    normalized_std,
)

if TYPE_CHECKING:  # it loads numba
    from pipeline.models.wishart.perturbation import Perturbations

RATIOS = np.geomspace(1e-5, 1e-1, 25)  # α₂/α₁ of the curve, in rad
FLOORS = (0.5, 0.3, 0.2, 0.1, 0.05, 0.01)  # ε of the table over ε and weight
RATIO_FACTORS = (0.25, 1.0, 4.0)  # on the weight of the fit, in the same table
TOLERANCE = 1e-3  # of ln α₂/α₁ at which σ̂_B equals the moment estimate
# of the likelihood search; a density exists only below the upper end
SIGMA_B_RANGE = (0.01, 2.0)
MARGIN = 1e-4  # in ln σ_B, distance of the search from the limit of the density
COARSE = 0.05  # of ln σ_B, tolerance of the search before the spline
# half width in ln σ_B and nodes of the spline; error below 1e-4
REACH = 0.4
NODES = 9
RATIO = "weights_ratio_alpha2_over_alpha1_rad"
Estimator = Literal["moments", "paper", "likelihood"]


@validation.options(kw_only=True)
class Options(base.Options):
    """``estimator``: ``moments``, ``paper`` (a convex problem on every step) or ``likelihood``."""

    estimator: Estimator = "moments"
    decomposition: Literal["by_shape", "pivoted_lu", "qr", "qr_transposed"] = "by_shape"
    # only for the paper's estimator: ε of B⁻¹ ⪰ εI
    floor: Annotated[float, Field(gt=0, lt=1)] = 0.2


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """Estimate σ_B by the estimator of ``options``; raises the errors of the estimator."""
    decomposition = _decomposition(options, recorded)
    if options.estimator == "paper":
        return fit_paper(recorded, decomposition, options.floor)
    fit = fit_moments if options.estimator == "moments" else fit_likelihood
    return fit(recorded, decomposition)


def _estimate(
    sigma_b: float,
    recorded: Recorded,
    decomposition: Decomposition,
    diagnostics: dict[str, float],
    from_takes: Callable[[ndarray], dict[str, float]],
    details: Any = None,
) -> Estimate:
    limit = largest_dispersion(len(recorded.chain.task), inverse_moments=2)
    diagnostics = {**diagnostics, "sigma_b_limit_of_the_covariance": limit}
    return Estimate(
        parameters=_parameters(sigma_b, decomposition),
        estimates={"sigma_b": sigma_b},
        diagnostics=diagnostics,
        details=details,
        from_takes=from_takes,
    )


def _decomposition(options: Options, recorded: Recorded) -> Decomposition:
    task = recorded.chain.task
    return decomposition_of(options.decomposition, task, recorded.joints)


def _parameters(sigma_b: float, decomposition: Decomposition) -> dict[str, Any]:
    name = decomposition.name
    return {"kind": "wishart", "sigma_b": sigma_b, "decomposition": name}


def estimator_options(options: Options) -> dict[str, Options]:
    """Options of every estimator, for the decomposition of ``options`` and for the control."""
    cases = {"": options}
    if options.decomposition != CONTROL.name:
        prefix = f"control_{CONTROL.name}_"
        cases[prefix] = replace(options, decomposition=CONTROL.name)
    by_pattern = {}
    for prefix, case in cases.items():
        for estimator in get_args(Estimator):
            pattern = f"{prefix}{{}}_{estimator}"
            by_pattern[pattern] = replace(case, estimator=estimator)
    return by_pattern


def truths(
    recorded: Recorded,
    options: Options,
    dispersions: Sequence[float],
) -> list[Truth]:
    """Return known parameters with σ_B = each of ``dispersions``."""
    decomposition = _decomposition(options, recorded)
    parameter_sets = []
    for sigma_b in dispersions:
        parameters = _parameters(sigma_b, decomposition)
        values = {"sigma_b": sigma_b}
        parameter_sets.append(Truth(f"wishart {sigma_b:g}", parameters, values))
    return parameter_sets


def diagnose(
    recorded: Recorded,
    options: Options,
    estimate: Estimate | None,
    checks: int,
    rng: Generator,
) -> tuple[dict[str, float], dict[str, pd.DataFrame]]:
    """Greatest relative difference between the closed form and the solver of (BsampOpt) at
    ``checks`` random moving steps, and the tables ``sigma_b_weights`` and ``sigma_b_floors``. The
    first has σ̂_B of (BsampOpt) over α₂/α₁, for the recorded takes and for as many takes drawn from
    the model of ``estimate``; the second over ε of B⁻¹ ⪰ εI and α₂/α₁, for the recorded takes.
    """
    decomposition = _decomposition(options, recorded)
    floor = options.floor
    metrics: dict[str, float] = {}
    try:
        fit = fit_paper(recorded, decomposition, floor)
        metrics = _solver_gap(recorded, decomposition, fit, floor, checks, rng)
        moments = fit_moments(recorded, decomposition).estimates["sigma_b"]
    except ModelDomainError as error:
        print(f"fit: no curve over the weights of the convex problem: {error}")
        return metrics, {}

    ratio = fit.diagnostics[RATIO]
    steps = problem_steps(recorded, decomposition)
    curve = _weight_curve(steps, floor, moments).assign(source="recorded")
    metrics["sigma_b_greatest_over_weights"] = curve["sigma_b"][: len(RATIOS)].max()
    curves = [curve]
    if estimate is not None:
        drawn = _drawn_takes(estimate.model, recorded, rng)
        curve = _weight_curve(problem_steps(drawn, decomposition), floor, moments)
        curves.append(curve.assign(source="drawn"))
    used = (ratio, fit.estimates["sigma_b"], "used", "recorded")
    curves.append(pd.DataFrame([used], columns=curves[0].columns))

    floors = _floor_table(steps, ratio)
    at_ratio = floors.loc[floors["ratio"] == ratio, "sigma_b"]
    metrics["sigma_b_least_over_floors"] = at_ratio.min()
    metrics["sigma_b_greatest_over_floors"] = at_ratio.max()
    weights = pd.concat(curves, ignore_index=True)
    return metrics, {"sigma_b_weights": weights, "sigma_b_floors": floors}


def _solver_gap(
    recorded: Recorded,
    decomposition: Decomposition,
    fit: Estimate,
    floor: float,
    checks: int,
    rng: Generator,
) -> dict[str, float]:
    """Return the number of moving steps, at most ``checks``, at which the objectives of the ``fit``
    by (BsampOpt) are compared with the solver's, and the greatest relative difference.
    """
    from pipeline.models.convex import perturbation_gap  # here: CVXPY imports slowly

    q, v, noise = moving_steps(recorded)
    checked = np.sort(rng.choice(len(q), min(checks, len(q)), replace=False))
    commanded = np.any(recorded.v, axis=-1)
    moving = np.flatnonzero(np.broadcast_to(commanded, recorded.q.shape[:2]))
    weights, objectives = fit.details
    problems = (
        objectives[moving[checked]],
        recorded.chain.jacobian(q[checked]),
        task_step(recorded.chain, v)[checked],
        noise[checked],
    )
    return {
        "convex_problems_checked": len(checked),
        "convex_check_greatest_relative_gap": perturbation_gap(
            problems,
            decomposition,
            weights,
            floor,
        ),
    }


def _floor_table(steps: tuple[ndarray, ...], ratio: float) -> pd.DataFrame:
    """Return σ̂_B of (BsampOpt) for each ε of FLOORS, at RATIO_FACTORS times ``ratio`` α₂/α₁."""
    rows = []
    for floor in FLOORS:
        for factor in RATIO_FACTORS:
            sigma_b = _sigma_b_at(steps, factor * ratio, floor)
            rows.append((floor, factor * ratio, sigma_b))
    return pd.DataFrame(rows, columns=["floor", "ratio", "sigma_b"])


def _sigma_b_at(steps: tuple[ndarray, ...], ratio: float, floor: float) -> float:
    """Return σ̂_B of (BsampOpt) at ``ratio`` α₂/α₁ in rad, with B⁻¹ ⪰ εI for ``floor`` ε."""
    weights = 1 / (1 + ratio), ratio / (1 + ratio)
    b, _ = solve_problems(steps, weights, floor)
    return float(np.sqrt(_squares_about_identity(b).mean(axis=0)).mean())


def _drawn_takes(model: WishartModel, recorded: Recorded, rng: Generator) -> Recorded:
    """Steps of ``model`` from the recorded poses and commands, with measurement noise."""
    from pipeline.models.draws import draw_steps  # here: it loads numba

    q = recorded.q
    v = recorded.v
    drawn, _ = draw_steps(model, recorded.chain, q, v, rng)
    zero = np.zeros(q.shape[-1])
    measured = rng.multivariate_normal(zero, recorded.measurement, q.shape[:-1])
    noise = drawn - q - recorded.chain.nominal_step(q, v) + measured
    return replace(recorded, noise=noise)


def _weight_curve(
    steps: tuple[ndarray, ...],
    floor: float,
    target: float,
) -> pd.DataFrame:
    """Return rows of ratio α₂/α₁ in rad, σ̂_B and point: at RATIOS, and where σ̂_B falls through
    ``target``.
    """
    from scipy.optimize import brentq

    curve = np.array([_sigma_b_at(steps, ratio, floor) for ratio in RATIOS])
    rows = [
        (ratio, sigma_b, "curve") for ratio, sigma_b in zip(RATIOS, curve, strict=True)
    ]
    above = curve > target
    falls = np.flatnonzero(above[:-1] & ~above[1:])
    if falls.size:
        low, high = np.log(RATIOS[falls[0] : falls[0] + 2])

        def excess(log_ratio: float) -> float:
            return _sigma_b_at(steps, np.exp(log_ratio), floor) - target

        log_ratio = brentq(excess, low, high, xtol=TOLERANCE)
        rows.append((float(np.exp(log_ratio)), target, "moments"))
    return pd.DataFrame(rows, columns=["ratio", "sigma_b", "point"])


def fit_moments(recorded: Recorded, decomposition: Decomposition) -> Estimate:
    """Return σ̂_B at which the mean of tr Cov over takes and steps plus tr Σ_m equals the recorded
    total variance. Raises SingularJacobianError, and ModelDomainError as :func:`take_variances` and
    :func:`dispersion_of_trace`.
    """
    a, back, _ = factors(recorded.chain, recorded.q, recorded.v, decomposition)
    every, nominal = (squares.mean(axis=1) for squares in step_squares(a, back))
    variances = take_variances(recorded)
    m = a.shape[-1]

    def from_takes(takes: ndarray) -> dict[str, float]:
        traces, measured = variances(takes)
        trace = float(traces.mean()) - measured
        means = every[takes].mean(), nominal[takes].mean()
        return {"sigma_b": dispersion_of_trace(*means, trace, m)}

    sigma_b = from_takes(np.arange(len(a)))["sigma_b"]
    return _estimate(sigma_b, recorded, decomposition, {}, from_takes)


def problem_steps(
    recorded: Recorded,
    decomposition: Decomposition,
) -> tuple[ndarray, ...]:
    """ω (takes, M, n) in rad, J₁⁻¹v (takes, M, m) and J₂⁺ (takes, M, n, m) of the convex problems;
    raises SingularJacobianError.
    """
    v = np.broadcast_to(recorded.v, (*recorded.q.shape[:-1], recorded.v.shape[-1]))
    a, back, _ = factors(recorded.chain, recorded.q, v, decomposition)
    return recorded.noise, a, back


def solve_problems(
    steps: tuple[ndarray, ...],
    weights: tuple[float, float],
    floor: float,
) -> tuple[ndarray, Perturbations]:
    """Solve Eqs. (BsampOpt) and (const10), as B⁻¹ ⪰ εI with ``floor`` ε, for :func:`problem_steps`
    with ``weights`` (α₁, α₂). Return B (takes, M, m, m), and the optimal perturbations, take by
    take.
    """
    from pipeline.models.wishart.perturbation import fit_perturbations

    noise, a, back = steps
    n, m = back.shape[-2:]
    flat = noise.reshape(-1, n), a.reshape(-1, m), back.reshape(-1, n, m)
    fits = fit_perturbations(*flat, weights, floor)
    return np.linalg.inv(np.eye(m) + fits.s.reshape(*a.shape, m)), fits


def _squares_about_identity(b: ndarray) -> ndarray:
    """Return σ̂_B² (takes, M) of ``b`` (takes, M, m, m), Eq. (NormStd) with E[B] = I."""
    return normalized_std(b[None], np.eye(b.shape[-1])) ** 2


def fit_paper(
    recorded: Recorded,
    decomposition: Decomposition,
    floor: float,
) -> Estimate:
    """σ̂_B = (1/M) Σ_k σ̂_Bk (Sec. "Motion uncertainty characterization"), with B⁻¹ ⪰ εI for
    ``floor`` ε. α₂/α₁ is the ratio of :func:`objective_weights` for the noise recorded at rest, or
    for the known Σ_m if the motion never rests. Raises ModelDomainError without either. Resampled
    takes keep the weights of all takes.
    """
    from pipeline.models.wishart.perturbation import objective_weights

    resting = _rest_noise(recorded)
    m = len(recorded.chain.task)
    weights = objective_weights(resting, m)
    b, fits = solve_problems(problem_steps(recorded, decomposition), weights, floor)
    squares = _squares_about_identity(b)
    dispersions = np.sqrt(squares.mean(axis=0))
    commanded = np.any(recorded.v, axis=-1)
    moving = np.broadcast_to(commanded, squares.shape).any(axis=0)
    unperturbed = ~fits.s.any(axis=(1, 2))
    diagnostics = {
        "sigma_b_greatest_over_time": dispersions.max(),
        "sigma_b_mean_over_moving_steps": dispersions[moving].sum()
        / max(moving.sum(), 1),
        "share_of_steps_at_rest": 1 - moving.mean(),
        RATIO: weights[1] / weights[0],
        "noise_at_rest_rms_rad": resting,
        "problems": len(fits.bound),
        "problems_without_perturbation": int(np.count_nonzero(unperturbed)),
        "problems_on_the_bound_of_definiteness": int(np.count_nonzero(fits.bound)),
        "sigma_b_about_the_sample_mean": normalized_std(b, b.mean(axis=0)).mean(),
    }
    for row, mean in enumerate(np.diagonal(b.mean(axis=(0, 1))), start=1):
        diagnostics[f"fitted_mean_of_b_{row}{row}"] = mean

    def from_takes(takes: ndarray) -> dict[str, float]:
        counts = np.bincount(takes, minlength=len(squares))
        return {"sigma_b": float(np.sqrt(counts @ squares / counts.sum()).mean())}

    # weights (α₁, α₂) and objectives (takes·M,) of the convex problems
    details = weights, fits.objective
    sigma_b = float(dispersions.mean())
    return _estimate(sigma_b, recorded, decomposition, diagnostics, from_takes, details)


def _rest_noise(recorded: Recorded) -> float:
    """Return the root mean square of ‖ω‖ in rad at rest, or of the known measurement noise if the
    motion never rests; 0 without either.
    """
    noise = recorded.noise
    measurement = recorded.known_measurement
    still = np.broadcast_to(~np.any(recorded.v, axis=-1), noise.shape[:-1])
    variance = 0.0
    if still.any():
        variance = np.mean(np.sum(noise[still] ** 2, axis=-1))
    elif measurement is not None:
        variance = np.trace(measurement)
    return float(np.sqrt(variance))


def fit_likelihood(recorded: Recorded, decomposition: Decomposition) -> Estimate:
    """Maximise Σ ln p(q̃_{k+1} | q̃_k) over steps with a command for σ̂_B. p is the exact density
    of a step plus measurement noise; without measurement noise the slowest steps would determine
    σ̂_B. Raises SingularJacobianError and ModelDomainError.
    """
    from scipy.optimize import minimize_scalar

    from pipeline.models.wishart import quadrature

    takes = len(recorded.q)
    m = len(recorded.chain.task)
    mixture = quadrature.mixture(*_blurred_steps(recorded, decomposition))

    def by_take(log_sigma_b: float) -> ndarray:
        d = degrees_of_freedom(np.exp(log_sigma_b), m)
        density = quadrature.mixture_log_density(mixture, d)
        return density.reshape(takes, -1).sum(axis=1)

    widest = min(largest_dispersion(m), SIGMA_B_RANGE[1])
    low = np.log(SIGMA_B_RANGE[0])
    high = np.log(widest) - MARGIN
    search = {"bounds": (low, high), "method": "bounded", "options": {"xatol": COARSE}}
    coarse = minimize_scalar(lambda x: -by_take(x).sum(), **search).x
    nodes = np.linspace(max(low, coarse - REACH), min(high, coarse + REACH), NODES)
    log_likelihoods = np.stack([by_take(node) for node in nodes], axis=1)
    best = _maximum(nodes, log_likelihoods.sum(axis=0))
    at_end = best in (low, high)

    def from_takes(takes: ndarray) -> dict[str, float]:
        best = _maximum(nodes, log_likelihoods[takes].sum(axis=0))
        if not at_end and best in (nodes[0], nodes[-1]):
            message = (
                "the maximum of these takes' likelihood is outside the evaluated range"
            )
            raise ModelDomainError(message, takes=takes.tolist())
        return {"sigma_b": float(np.exp(best))}

    diagnostics = {"sigma_b_at_the_end_of_its_interval": at_end}
    sigma_b = float(np.exp(best))
    return _estimate(sigma_b, recorded, decomposition, diagnostics, from_takes)


def _blurred_steps(
    recorded: Recorded,
    decomposition: Decomposition,
) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """Return the steps with a command without their part in the null space of J, a, J₂⁺ and Σ_m;
    raises ModelDomainError for a singular Σ_m.
    """
    chain = recorded.chain
    measurement = recorded.measurement
    q, v, noise = moving_steps(recorded)
    q_next = q + chain.nominal_step(q, v) + noise
    step = q_next - q - chain.null_step(q, v)
    a, back, _ = factors(chain, q, v, decomposition)
    _ = normal_log_density(step, measurement)  # raises
    every = np.ones(len(a), dtype=bool)  # contiguous copies
    return step[every], a[every], back[every], measurement


def _maximum(nodes: ndarray, values: ndarray) -> float:
    """Return where the spline through ``values`` at ``nodes`` is greatest between the ends."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(nodes, values)
    extrema = spline.derivative().roots(extrapolate=False)
    candidates = np.concatenate([nodes[[0, -1]], extrema])
    return float(candidates[spline(candidates).argmax()])
