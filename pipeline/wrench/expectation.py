"""The expectation of the optimal Σ_S over the systems within given bounds, which the average over
drawn systems estimates.

Without its bound Σ_S has an expectation in nested one-dimensional integrals. What the bound Σ_S ≥ 0
adds has a kink inside the 4m-dimensional range of the systems; it is small, so quasi-Monte Carlo of
it alone leaves a small error, which the scrambles state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import quad
from scipy.stats import qmc

from pipeline.core.errors import SolverError
from pipeline.wrench.bounds import Bounds, systems_at
from pipeline.wrench.matrix import FORMS, matrix_model, optimal_sigma_s, unbounded_sigma_s
from pipeline.wrench.parametric import force_covariance, mean_resultant_length

NODES, WEIGHTS = np.polynomial.legendre.leggauss(96)
SHARE_TOLERANCE = 1e-9  # of the outer integral, which lies between 0 and 1
SCRAMBLES = 16
LOG2_POINTS = 12  # of each scramble of the Sobol sequence


@dataclass(frozen=True)
class ExpectedSigmaS:
    """E[Σ_S] over the systems within bounds, and how far single systems are off it."""

    mean: np.ndarray  # (2, 2)
    standard_error: np.ndarray  # (2, 2) of the quasi-Monte Carlo part, from its scrambles
    deviation: np.ndarray  # (2, 2) standard deviation of each entry over the systems


def _uniform_mean(
    function: Callable[[np.ndarray], np.ndarray], bounds: tuple[float, float]
) -> np.ndarray:
    """E[f(X)] of X uniform within ``bounds`` by Gauss–Legendre quadrature; f maps nodes (...,
    nodes) to values of the same shape.
    """
    low, high = bounds
    return function(low + (high - low) * (NODES + 1) / 2) @ WEIGHTS / 2


def expected_unbounded_sigma_s(bounds: Bounds, agents: int) -> np.ndarray:
    """E[M], (2, 2), of the unbounded Σ_S of systems of ``agents`` cables with values uniform within
    ``bounds``.

    M = Σᵢ(T̲ᵢ²Gᵢ + σ_Tᵢ²Hᵢ)/D, D = Σᵢ(T̲ᵢ² + σ_Tᵢ²). Gᵢ and Hᵢ depend on direction and
    concentration alone, so E[M] = E[G]·p + E[H]·(1 − p) with p = E[ΣT̲ᵢ²/D]. By 1/D = ∫exp(−sD)ds
    that is p = ∫m·E[T̲²e^(−sT̲²)]·E[e^(−sT̲²)]^(m−1)·E[e^(−sσ_T²)]^m ds. Raises SolverError where
    that integral does not converge.
    """
    squared_length = _uniform_mean(lambda k: mean_resultant_length(k) ** 2, bounds.concentration)
    ratio = _uniform_mean(lambda k: mean_resultant_length(k) / k, bounds.concentration)
    cos2, sin2 = (
        _uniform_mean(lambda t: np.cos(2 * t), bounds.direction),
        _uniform_mean(lambda t: np.sin(2 * t), bounds.direction),
    )
    turned = np.array([[cos2, sin2], [sin2, -cos2]])
    g = (1 - squared_length) * (np.eye(2) + turned) / 2 - ratio * turned
    h = -ratio * turned

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
    return g * share + h * (1 - share)


def expected_sigma_s(
    bounds: Bounds, agents: int, rng: np.random.Generator
) -> dict[str, ExpectedSigmaS]:
    """E[Σ_S] in each of its forms of systems of ``agents`` cables with values uniform within
    ``bounds``.

    E[M], exact to quadrature, plus E[Σ_S − M] by ``SCRAMBLES`` scrambled Sobol sequences.
    """
    exact = expected_unbounded_sigma_s(bounds, agents)
    corrections: dict[str, list[np.ndarray]] = {form: [] for form in FORMS}
    squares: dict[str, list[np.ndarray]] = {form: [] for form in FORMS}
    for scramble in rng.spawn(SCRAMBLES):
        points = qmc.Sobol(4 * agents, rng=scramble).random_base2(LOG2_POINTS)
        systems = systems_at(bounds, np.moveaxis(points.reshape(len(points), 4, agents), 1, 0))
        unbounded = unbounded_sigma_s(matrix_model(systems), force_covariance(systems))
        for form in FORMS:
            sigma_s, _ = optimal_sigma_s(unbounded, form)
            target = unbounded if form == "full" else unbounded * np.eye(2)
            corrections[form].append(np.mean(sigma_s - target, axis=0))
            squares[form].append(np.mean(sigma_s**2, axis=0))
    by_form = {}
    for form, values in corrections.items():
        mean = (exact if form == "full" else exact * np.eye(2)) + np.mean(values, axis=0)
        deviation = np.sqrt(np.maximum(np.mean(squares[form], axis=0) - mean**2, 0.0))
        by_form[form] = ExpectedSigmaS(
            mean, np.std(values, axis=0, ddof=1) / np.sqrt(SCRAMBLES), deviation
        )
    return by_form
