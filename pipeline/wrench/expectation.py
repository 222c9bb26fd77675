"""The expectation of the optimal Σ_S over the systems within given bounds, which the average over
drawn systems estimates.

Without its bound Σ_S has an expectation in nested one-dimensional integrals. What the bound Σ_S ≥ 0
adds has a kink inside the many-dimensional range of the systems; it is small, so quasi-Monte Carlo
of it alone leaves a small error, which the scrambles state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import SolverError
from pipeline.wrench.bounds import Bounds, systems_at, within
from pipeline.wrench.directions import mean_resultant_length
from pipeline.wrench.matrix import FORMS, matrix_model, optimal_sigma_s, unbounded_sigma_s
from pipeline.wrench.parametric import wrench_covariance, wrench_map

NODES, WEIGHTS = np.polynomial.legendre.leggauss(96)
SHARE_TOLERANCE = 1e-9  # of the outer integral, which lies between 0 and 1
SCRAMBLES = 16
LOG2_POINTS = 12  # of each scramble of the Sobol sequence


@dataclass(frozen=True)
class ExpectedSigmaS:
    """E[Σ_S] over the systems within bounds, and how far single systems are off it."""

    mean: np.ndarray  # (n, n)
    standard_error: np.ndarray  # (n, n) of the quasi-Monte Carlo part, from its scrambles
    deviation: np.ndarray  # (n, n) standard deviation of each entry over the systems


def _uniform_mean(
    function: Callable[[np.ndarray], np.ndarray], bounds: tuple[float, float]
) -> np.ndarray:
    """E[f(X)] of X uniform within ``bounds`` by Gauss–Legendre quadrature; f maps nodes (...,
    nodes) to values of the same shape.
    """
    return function(within(bounds, (NODES + 1) / 2)) @ WEIGHTS / 2


def _direction_moment(bounds: Bounds) -> np.ndarray:
    """E[e̲e̲ᵀ], (p, p), of the nominal directions within ``bounds``, by the same quadrature."""
    p = bounds.dimension
    nodes = bounds.directions(*np.meshgrid(*[(NODES + 1) / 2] * (p - 1))).reshape(-1, p)
    weights = np.prod(np.meshgrid(*[WEIGHTS / 2] * (p - 1)), axis=0).ravel()
    return np.einsum("k,ki,kj->ij", weights, nodes, nodes)


def _at_attachments(matrix: np.ndarray, bounds: Bounds) -> np.ndarray:
    """E[GXGᵀ], (n, n), of X = ``matrix`` (p, p) over attachments within ``bounds``: G is affine in
    the coordinates of r, which are independent.
    """
    if bounds.attachment is None:
        return matrix
    low, high = bounds.attachment
    g = wrench_map(np.full(bounds.dimension, (low + high) / 2))
    slopes = wrench_map(np.eye(bounds.dimension)) - wrench_map(np.zeros(bounds.dimension))
    spread = np.einsum("kip,pq,kjq->ij", slopes, matrix, slopes) * (high - low) ** 2 / 12
    return g @ matrix @ g.T + spread


def expected_unbounded_sigma_s(bounds: Bounds, agents: int) -> np.ndarray:
    """E[M], (n, n), of the unbounded Σ_S of systems of ``agents`` cables with values uniform within
    ``bounds``.

    M = Σᵢ(T̲ᵢ²Uᵢ + σ_Tᵢ²Vᵢ)/D, D = Σᵢ(T̲ᵢ² + σ_Tᵢ²). Uᵢ and Vᵢ depend on direction, attachment and
    concentration alone: V = G{(A/κ)(I − p·e̲e̲ᵀ)}Gᵀ, U = V + (1 − A²)·Ge̲e̲ᵀGᵀ. So E[M] = E[U]·h
    + E[V]·(1 − h) with the share h = E[ΣT̲ᵢ²/D]. By 1/D = ∫exp(−sD)ds that is h =
    ∫m·E[T̲²e^(−sT̲²)]·E[e^(−sT̲²)]^(m−1)·E[e^(−sσ_T²)]^m ds. Raises SolverError where that
    integral does not converge.
    """
    from scipy.integrate import quad

    p = bounds.dimension
    squared_length = _uniform_mean(lambda k: mean_resultant_length(k, p) ** 2, bounds.concentration)
    ratio = _uniform_mean(lambda k: mean_resultant_length(k, p) / k, bounds.concentration)
    along = _direction_moment(bounds)
    v = _at_attachments(ratio * (np.eye(p) - p * along), bounds)
    u = v + _at_attachments((1 - squared_length) * along, bounds)

    def second_moment(range_: tuple[float, float]) -> float:
        return float(_uniform_mean(np.square, range_))

    scale = agents * (second_moment(bounds.tension) + second_moment(bounds.tension_sd))

    def integrand(r: float) -> float:
        s = r / scale
        noise = _uniform_mean(lambda v: np.exp(-s * v**2), bounds.tension_sd)
        tension = _uniform_mean(lambda t: np.exp(-s * t**2), bounds.tension)
        weighted = _uniform_mean(lambda t: t**2 * np.exp(-s * t**2), bounds.tension)
        return float(agents * weighted * tension ** (agents - 1) * noise**agents / scale)

    share, error, _, *warning = quad(
        integrand, 0, np.inf, epsabs=SHARE_TOLERANCE, epsrel=0.0, full_output=True
    )
    if warning or error > SHARE_TOLERANCE:
        raise SolverError(
            "the integral for E[Σ_S] did not converge: narrow the bounds of the tensions",
            error=error,
        )
    return u * share + v * (1 - share)


def expected_sigma_s(
    bounds: Bounds, agents: int, rng: np.random.Generator
) -> dict[str, ExpectedSigmaS]:
    """E[Σ_S] in each of its forms of systems of ``agents`` cables with values uniform within
    ``bounds``.

    E[M], exact to quadrature, plus E[Σ_S − M] by ``SCRAMBLES`` scrambled Sobol sequences.
    """
    from scipy.stats import qmc

    exact = expected_unbounded_sigma_s(bounds, agents)
    corrections: dict[str, list[np.ndarray]] = {form: [] for form in FORMS}
    squares: dict[str, list[np.ndarray]] = {form: [] for form in FORMS}
    for scramble in rng.spawn(SCRAMBLES):
        points = qmc.Sobol(bounds.coordinates * agents, rng=scramble).random_base2(LOG2_POINTS)
        shares = points.reshape(len(points), bounds.coordinates, agents)
        systems = systems_at(bounds, np.moveaxis(shares, 1, 0))
        unbounded = unbounded_sigma_s(matrix_model(systems), wrench_covariance(systems))
        for form in FORMS:
            sigma_s, _ = optimal_sigma_s(unbounded, form)
            target = unbounded if form == "full" else unbounded * np.eye(len(exact))
            corrections[form].append(np.mean(sigma_s - target, axis=0))
            squares[form].append(np.mean(sigma_s**2, axis=0))
    by_form = {}
    for form, values in corrections.items():
        mean = (exact if form == "full" else exact * np.eye(len(exact))) + np.mean(values, axis=0)
        deviation = np.sqrt(np.maximum(np.mean(squares[form], axis=0) - mean**2, 0.0))
        by_form[form] = ExpectedSigmaS(
            mean, np.std(values, axis=0, ddof=1) / np.sqrt(SCRAMBLES), deviation
        )
    return by_form
