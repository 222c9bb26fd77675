"""Minimisation over positive semidefinite matrices, the boundary included, through their factors
(Burer and Monteiro 2003).

With X = LLᵀ, L square, every L stands for some X ⪰ 0, and a quasi-Newton search in L needs no
constraint: ∂f/∂L = 2GL for G = ∂f/∂X. But a singular L may be stationary without being a minimum (L
= 0 always is). What tells is the first-order condition in X itself: a minimum has GX = 0 and G ⪰ 0.
Where G has a negative part, f falls along X + tN, N ⪰ 0 that part with its sign turned, and the
search goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import SolverError

FLAT = 1e-5  # greatest slope, in L and along any X + tN of unit size, of what is at its minimum
SEARCHES = 20

# f and its slopes by each matrix, symmetric
Objective = Callable[[list[np.ndarray]], tuple[float, list[np.ndarray]]]


@dataclass(frozen=True)
class Minimum:
    """Where f is least, and f there."""

    matrices: list[np.ndarray]
    value: float


def minimise(objective: Objective, matrices: Sequence[np.ndarray]) -> Minimum:
    """A local minimum of ``objective`` f over positive semidefinite ``matrices`` (k, k), which name
    where the search starts.

    They should be of a scale near one, and so should f. f may be infinite where it is not defined,
    yet not at the start. Raises SolverError where the search does not end at a minimum.
    """
    from scipy.optimize import minimize

    sizes = [len(matrix) for matrix in matrices]
    ends = np.cumsum([size**2 for size in sizes])[:-1]

    def split(theta: np.ndarray) -> list[np.ndarray]:
        parts = zip(np.split(theta, ends), sizes, strict=True)
        return [entries.reshape(size, size) for entries, size in parts]

    def in_factors(theta: np.ndarray) -> tuple[float, np.ndarray]:
        factors = split(theta)
        value, slopes = objective([factor @ factor.T for factor in factors])
        parts = zip(slopes, factors, strict=True)
        return value, np.concatenate([2 * (slope @ factor).ravel() for slope, factor in parts])

    matrices = list(matrices)
    for _ in range(SEARCHES):
        result = minimize(
            in_factors,
            np.concatenate([_root(matrix).ravel() for matrix in matrices]),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": 2000, "maxfun": 4000, "ftol": 1e-14, "gtol": 1e-7, "maxcor": 20},
        )
        steepest = float(np.abs(result.jac).max())
        # of what the search says of itself nothing is taken: its line search may stop where values
        # cannot be told apart
        if not (steepest < FLAT and np.isfinite(result.fun)):
            raise SolverError(
                "the search over positive semidefinite matrices did not end at a minimum: "
                f"{result.message}",
                slope=steepest,
            )
        matrices = [factor @ factor.T for factor in split(result.x)]
        slopes = objective(matrices)[1]
        lower = _descend(lambda tried: objective(tried)[0], matrices, slopes, result.fun)
        if lower is None:
            return Minimum(matrices, float(result.fun))
        matrices = lower
    raise SolverError(
        f"the search over positive semidefinite matrices found no minimum in {SEARCHES} attempts"
    )


def _root(matrix: np.ndarray) -> np.ndarray:
    values, axes = np.linalg.eigh(matrix)
    return (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T


def _negative_part(slope: np.ndarray) -> np.ndarray:
    values, axes = np.linalg.eigh((slope + slope.T) / 2)
    return (axes * np.maximum(-values, 0.0)) @ axes.T


def _descend(
    objective: Callable[[list[np.ndarray]], float],
    matrices: list[np.ndarray],
    slopes: list[np.ndarray],
    value: float,
) -> list[np.ndarray] | None:
    """X + tN, t halved from where N is of size one until f is less than ``value``; None where f
    does not fall, or not by more than rounding.
    """
    falls = [_negative_part(slope) for slope in slopes]
    size = max(np.linalg.norm(fall, 2) for fall in falls)
    if size < FLAT:
        return None
    for step in 0.5 ** np.arange(50) / size:
        tried = [matrix + step * fall for matrix, fall in zip(matrices, falls, strict=True)]
        if objective(tried) < value:
            return tried
    return None
