"""Numerical study: Σ_S from bounds on the cable system, and the error of Σ_S on fresh systems.

Σ_S is an average over drawn systems, and is compared with its expectation.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray
from numpy.random import Generator

from pipeline.core.errors import ConfigError, SolverError
from pipeline.core.options.analysis import Wrench
from pipeline.wrench import models

NODES, WEIGHTS = np.polynomial.legendre.leggauss(96)
# absolute tolerance of the integral h, which lies between 0 and 1
SHARE_TOLERANCE = 1e-9
SCRAMBLES = 16
# binary logarithm of the points in each scramble of the Sobol sequence
LOG2_POINTS = 12


class SigmaS(NamedTuple):
    """Σ_S averaged over drawn systems, or its expectation over the systems within bounds."""

    mean: ndarray  # (n, n)
    # (n, n) of the mean, or of the expectation over the scrambles
    standard_error: ndarray
    deviation: ndarray  # (n, n) standard deviation of each entry over the systems
    systems: int = 0
    clipped: int = 0  # number of eigenvalues that the bound Σ_S ≥ 0 sets to 0


def averaged_sigma_s(systems: models.CableSystem) -> dict[str, SigmaS]:
    """Return the mean of the optimal Σ_S of ``systems`` (s, m) by form; raises ConfigError for
    fewer than two systems.
    """
    count = len(systems.tension)
    if count < 2:
        raise ConfigError("the average of Σ_S needs at least 2 systems", systems=count)
    unbounded = models.unbounded_sigma_s(systems)
    estimates = {}
    for form in models.FORMS:
        optimal, clipped = models.optimal_sigma_s(unbounded, form)
        deviation = optimal.std(axis=0, ddof=1)
        estimates[form] = SigmaS(
            mean=optimal.mean(axis=0),
            standard_error=deviation / np.sqrt(count),
            deviation=deviation,
            systems=count,
            clipped=int(clipped.sum()),
        )
    return estimates


def _uniform_mean(function: Callable, bounds: Sequence[float]) -> ndarray:
    """Return E[f(X)], X uniform within ``bounds``, by Gauss–Legendre quadrature (last axis)."""
    return function(models.interpolate(bounds, (NODES + 1) / 2)) @ WEIGHTS / 2


def _at_attachments(matrix: ndarray, bounds: models.Bounds) -> ndarray:
    """Return E[GXGᵀ] (n, n) for X = ``matrix`` (p, p); G is affine in the attachment."""
    if bounds.attachment is None:
        return matrix
    low, high = bounds.attachment
    middle = models.wrench_map(np.full(bounds.dimension, (low + high) / 2))
    still = models.wrench_map(np.zeros(bounds.dimension))
    slopes = models.wrench_map(np.eye(bounds.dimension)) - still
    of_slopes = np.einsum("kip,pq,kjq->ij", slopes, matrix, slopes)
    variance = of_slopes * (high - low) ** 2 / 12
    return middle @ matrix @ middle.T + variance


def expected_unbounded_sigma_s(bounds: models.Bounds, agents: int) -> ndarray:
    """Return E[M] (n, n), M the unbounded Σ_S of ``agents`` cables with values in ``bounds``.

    M = Σᵢ(T̲ᵢ²Uᵢ + σ_Tᵢ²Vᵢ)/D, D = Σᵢ(T̲ᵢ² + σ_Tᵢ²), V = G{(A/κ)(I − p·e̲e̲ᵀ)}Gᵀ and U = V +
    (1 − A²)·Ge̲e̲ᵀGᵀ independent of the tensions. So E[M] = E[U]·h + E[V]·(1 − h), and from 1/D =
    ∫exp(−sD)ds, h = E[ΣT̲ᵢ²/D] = ∫m·E[T̲²e^(−sT̲²)]·E[e^(−sT̲²)]^(m−1)·E[e^(−sσ_T²)]^m ds. Raises
    SolverError if the integral h does not converge.
    """
    p = bounds.dimension
    length = partial(models.mean_resultant_length, dimension=p)
    squared_length = _uniform_mean(lambda k: length(k) ** 2, bounds.concentration)
    ratio = _uniform_mean(lambda k: length(k) / k, bounds.concentration)
    along = _mean_projection(bounds)
    v = _at_attachments(ratio * (np.eye(p) - p * along), bounds)
    u = v + _at_attachments((1 - squared_length) * along, bounds)
    share = _tension_share(bounds, agents)
    return u * share + v * (1 - share)


def _mean_projection(bounds: models.Bounds) -> ndarray:
    """Return E[e̲e̲ᵀ] (p, p) of a cable's direction e̲ within ``bounds``."""
    angles = bounds.dimension - 1  # of a direction
    shares = np.meshgrid(*[(NODES + 1) / 2] * angles)
    weights = np.meshgrid(*[WEIGHTS / 2] * angles)
    weight = np.prod(weights, axis=0).ravel()
    nodes = bounds.directions(*shares).reshape(-1, bounds.dimension)
    return np.einsum("k,ki,kj->ij", weight, nodes, nodes)


def _tension_share(bounds: models.Bounds, agents: int) -> float:
    """Return h = E[ΣT̲ᵢ²/D] of :func:`expected_unbounded_sigma_s` by quadrature over r = s·E[D]."""
    from scipy.integrate import quad

    tensions = bounds.tension
    deviations = bounds.tension_sd
    squares = [float(_uniform_mean(np.square, b)) for b in (tensions, deviations)]
    scale = agents * sum(squares)

    def integrand(r: float) -> float:
        s = r / scale

        def damped(x: ndarray) -> ndarray:
            return np.exp(-s * x**2)

        noise = _uniform_mean(damped, deviations)
        tension = _uniform_mean(damped, tensions)
        weighted = _uniform_mean(lambda t: t**2 * damped(t), tensions)
        density = agents * weighted * tension ** (agents - 1) * noise**agents
        return float(density / scale)

    share, error, _, *warning = quad(
        integrand,
        0,
        np.inf,
        epsabs=SHARE_TOLERANCE,
        epsrel=0.0,
        full_output=True,
    )
    if warning or error > SHARE_TOLERANCE:
        message = "the integral for E[Σ_S] did not converge: narrow the bounds of the tensions"
        raise SolverError(message, error=error)
    return share


def expected_sigma_s(
    bounds: models.Bounds,
    agents: int,
    rng: Generator,
) -> dict[str, SigmaS]:
    """Return E[Σ_S] by form for ``agents`` cables with values uniform within ``bounds``: E[M] by
    quadrature plus the small E[Σ_S − M] by scrambled Sobol sequences.
    """
    from scipy.stats import qmc

    exact = expected_unbounded_sigma_s(bounds, agents)
    masks = {"diagonal": np.eye(len(exact)), "full": np.ones_like(exact)}
    corrections = {form: [] for form in masks}
    squares = {form: [] for form in masks}
    for scramble in rng.spawn(SCRAMBLES):
        sequence = qmc.Sobol(bounds.coordinates * agents, rng=scramble)
        points = sequence.random_base2(LOG2_POINTS)
        shares = points.reshape(len(points), bounds.coordinates, agents)
        systems = models.systems_at(bounds, np.moveaxis(shares, 1, 0))
        unbounded = models.unbounded_sigma_s(systems)
        for form, mask in masks.items():
            sigma_s, _ = models.optimal_sigma_s(unbounded, form)
            corrections[form].append(np.mean(sigma_s - unbounded * mask, axis=0))
            squares[form].append(np.mean(sigma_s**2, axis=0))

    by_form = {}
    for form, mask in masks.items():
        correction = np.array(corrections[form])
        mean = exact * mask + correction.mean(axis=0)
        variance = np.array(squares[form]).mean(axis=0) - mean**2
        error = correction.std(axis=0, ddof=1) / np.sqrt(SCRAMBLES)
        by_form[form] = SigmaS(mean, error, np.sqrt(np.maximum(variance, 0.0)))
    return by_form


def variance_errors(modelled: ndarray, covariance: ndarray) -> ndarray:
    """Return the paper's error ‖diag Cov(W) − Var‖/‖Var‖ (...) of the ``modelled`` covariance."""
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    off = np.diagonal(modelled, axis1=-2, axis2=-1) - variances
    return np.linalg.norm(off, axis=-1) / np.linalg.norm(variances, axis=-1)


def covariance_errors(modelled: ndarray, covariance: ndarray) -> ndarray:
    """Return the error ‖Cov(W) − Cov‖_F/‖Cov‖_F (...) of the whole covariance (..., n, n)."""
    difference = np.linalg.norm(modelled - covariance, axis=(-2, -1))
    return difference / np.linalg.norm(covariance, axis=(-2, -1))


def sigma_s_rows(
    system_class: str,
    agents: int,
    estimates: dict[str, SigmaS],
    expected: dict[str, SigmaS],
) -> pd.DataFrame:
    """Return the rows of the table ``sigma_s`` of one class of systems, one for each entry."""
    tables = []
    for form, average in estimates.items():
        limit = expected[form]
        i, j = np.triu_indices(len(average.mean))
        columns = {
            "mean": average.mean,
            "standard_error": average.standard_error,
            "expectation": limit.mean,
            "expectation_error": limit.standard_error,
            "expected_standard_error": limit.deviation / np.sqrt(average.systems),
        }
        row = {"system_class": system_class, "agents": agents, "form": form}
        row["entry"] = [f"{a}{b}" for a, b in zip(i + 1, j + 1, strict=True)]
        row |= {name: matrix[i, j] for name, matrix in columns.items()}
        tables.append(pd.DataFrame(row).assign(clipped=average.clipped))
    return pd.concat(tables, ignore_index=True)


def run_study(
    options: Wrench,
    rng: Generator,
    run: Callable = map,
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Return the tables ``sigma_s`` and ``wrench_errors`` of the first repeat and ``wrench_spread``
    of all ``repeats``, Fig. (ErrWrnRMT); ``run`` maps a function over the repeats.

    For each number of cables in ``agents``, Σ_S is averaged over ``systems`` systems and tested on
    ``test_systems`` others: the paper's error with the diagonal Σ_S and with Σ_S = 0 (control), and
    the covariance error.
    """
    repeats = list(enumerate(rng.spawn(options.repeats)))
    trial = partial(_repeat, options)
    sigma_rows = []
    errors = []
    spread = []
    for of_repeat in run(trial, repeats):
        sigma_rows += of_repeat.sigma_s
        errors += of_repeat.errors
        spread += of_repeat.spread
    return (
        pd.concat(sigma_rows, ignore_index=True),
        pd.concat(errors, ignore_index=True),
        pd.concat(spread, ignore_index=True),
    )


class Repeat(NamedTuple):
    """Rows of the three tables of one repeat, a table for each number of cables."""

    sigma_s: list[pd.DataFrame]
    errors: list[pd.DataFrame]
    spread: list[pd.DataFrame]


def _repeat(options: Wrench, trial: tuple[int, Generator]) -> Repeat:
    """Return the rows of one ``trial`` (number of the repeat, stream)."""
    number, rng = trial
    bounds = models.study_bounds(options)
    rows = Repeat([], [], [])
    for m, m_rng in zip(options.agents, rng.spawn(len(options.agents)), strict=True):
        drawn = models.draw_systems(bounds, options.systems, m, m_rng)
        estimates = averaged_sigma_s(drawn)
        fresh = models.draw_systems(bounds, options.test_systems, m, m_rng)
        model = models.matrix_model(fresh)
        covariance = models.wrench_covariance(fresh)
        modelled = {
            form: model.covariance(estimate.mean)
            for form, estimate in estimates.items()
        }
        error = variance_errors(modelled["diagonal"], covariance)
        # the control: the actuation is the only cause of variance
        without = variance_errors(model.actuation_part(), covariance)
        row = {
            "agents": m,
            "repeat": number,
            "mean": error.mean(),
            "maximum": error.max(),
            "mean_without_matrix": without.mean(),
        }
        rows.spread.append(pd.DataFrame([row]))
        if number > 0:
            continue
        expected = expected_sigma_s(bounds, m, m_rng.spawn(1)[0])
        rows.sigma_s.append(sigma_s_rows("study", m, estimates, expected))
        table = {"agents": m, "system": np.arange(len(error)), "error": error}
        for form, matrix in modelled.items():
            table[f"covariance_error_{form}"] = covariance_errors(matrix, covariance)
        rows.errors.append(pd.DataFrame(table))
    return rows
