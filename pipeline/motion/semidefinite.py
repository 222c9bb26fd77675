"""Minimisation over positive semidefinite matrices, the boundary included, through their factors (Burer and Monteiro 2003).

With X = LLᵀ, L square, every L stands for some X ⪰ 0, and a quasi-Newton search in L needs no constraint: ∂f/∂L = 2GL for G = ∂f/∂X. But a
singular L may be stationary without being a minimum (L = 0 always is). What tells is the first-order condition in X itself: a minimum
has GX = 0 and G ⪰ 0. Where G has a negative part, f falls along X + tN, N ⪰ 0 that part with its sign turned, and the search goes on
from there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from pipeline.errors import SolverError

FLAT = 1e-5  # greatest slope, in L and along any X + tN of unit size, of what is at its minimum
SEARCHES = 20

# f and its slopes: by each matrix, symmetric, and by the numbers
Objective = Callable[[list[np.ndarray], np.ndarray], tuple[float, list[np.ndarray], np.ndarray]]


@dataclass(frozen=True)
class Minimum:
    """Where f is least, and f there."""

    matrices: list[np.ndarray]
    numbers: np.ndarray
    value: float


def minimise(
    objective: Objective,
    matrices: Sequence[np.ndarray],
    numbers: Sequence[float] = (),
    bounds: Sequence[tuple[float, float]] = (),
) -> Minimum:
    """A local minimum of ``objective`` f over positive semidefinite ``matrices`` (k, k) and, within ``bounds``, ``numbers``.

    The two name where the search starts. All should be of a scale near one, and so should f. f may be infinite where it is not defined,
    yet not at the start. Raises SolverError where the search does not end at a minimum.
    """
    sizes = [len(matrix) for matrix in matrices]
    ends = np.cumsum([size**2 for size in sizes])

    def split(theta: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        *flat, rest = np.split(theta, ends)
        return [entries.reshape(size, size) for entries, size in zip(flat, sizes, strict=True)], rest

    def in_factors(theta: np.ndarray) -> tuple[float, np.ndarray]:
        factors, rest = split(theta)
        value, slopes, of_rest = objective([factor @ factor.T for factor in factors], rest)
        return value, np.concatenate([*(2 * (slope @ factor).ravel() for slope, factor in zip(slopes, factors, strict=True)), of_rest])

    limits = [(-np.inf, np.inf)] * int(ends[-1]) + list(bounds)
    matrices, numbers = list(matrices), np.array(numbers, dtype=float)
    for _ in range(SEARCHES):
        start = np.concatenate([*(_root(matrix).ravel() for matrix in matrices), numbers])
        found = minimize(
            in_factors, start, jac=True, method="L-BFGS-B", bounds=limits,
            options={"maxiter": 2000, "maxfun": 4000, "ftol": 1e-14, "gtol": 1e-7, "maxcor": 20},
        )  # fmt: skip
        steepest = _steepest(found.x, found.jac, limits)
        # of what the search says of itself nothing is taken: its line search may stop where values cannot be told apart
        if not (steepest < FLAT and np.isfinite(found.fun)):
            raise SolverError(f"the search over positive semidefinite matrices did not end at a minimum: {found.message}", slope=steepest)
        factors, numbers = split(found.x)
        matrices = [factor @ factor.T for factor in factors]
        slopes = objective(matrices, numbers)[1]
        lower = _descend(lambda tried, kept=numbers: objective(tried, kept)[0], matrices, slopes, found.fun)
        if lower is None:
            return Minimum(matrices, numbers, float(found.fun))
        matrices = lower
    raise SolverError(f"the search over positive semidefinite matrices found no minimum in {SEARCHES} attempts")


def _steepest(theta: np.ndarray, gradient: np.ndarray, limits: list[tuple[float, float]]) -> float:
    """Greatest slope but for one that points out of its limits at their end."""
    low, high = np.array(limits).T
    return float(np.abs(np.clip(theta - gradient, low, high) - theta).max())


def _root(matrix: np.ndarray) -> np.ndarray:
    values, axes = np.linalg.eigh(matrix)
    return (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T


def _negative_part(slope: np.ndarray) -> np.ndarray:
    values, axes = np.linalg.eigh((slope + slope.T) / 2)
    return (axes * np.maximum(-values, 0.0)) @ axes.T


def _descend(
    objective: Callable[[list[np.ndarray]], float], matrices: list[np.ndarray], slopes: list[np.ndarray], value: float
) -> list[np.ndarray] | None:
    """X + tN, t halved from where N is of size one until f is less than ``value``; None where f does not fall, or not by more than
    rounding."""
    falls = [_negative_part(slope) for slope in slopes]
    size = max(np.linalg.norm(fall, 2) for fall in falls)
    if size < FLAT:
        return None
    for step in 0.5 ** np.arange(50) / size:
        tried = [matrix + step * fall for matrix, fall in zip(matrices, falls, strict=True)]
        if objective(tried) < value:
            return tried
    return None
