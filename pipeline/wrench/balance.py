"""Mean cable tensions that give the desired force at the platform."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import nnls

from pipeline.errors import ConfigError


def balance(directions: Sequence[float], force: Sequence[float], low: float, high: float) -> np.ndarray:
    """Tensions T (m,) in N with S(θ)·T = ``force`` (2,) in N and low ≤ T ≤ high that lie closest to the middle of the bounds.

    ``directions`` θ (m,) in rad. On the tensions that give the force, T = T₀ + N·z with T₀ the nearest to the middle and N a basis of
    the null space, this is a least-distance problem in z, solved as Lawson & Hanson (Solving Least Squares Problems, ch. 23) do by
    non-negative least squares: exact, and certain about infeasibility. Raises ConfigError where no tensions within the bounds give
    the force.
    """
    directions, force = np.asarray(directions, dtype=float), np.asarray(force, dtype=float)
    if not (np.isfinite(directions).all() and np.isfinite(force).all() and directions.size):
        raise ConfigError("directions and force must be finite numbers, one direction per cable", key="directions")
    jacobian = np.stack([np.cos(directions), np.sin(directions)])
    middle = np.full(jacobian.shape[1], (low + high) / 2)
    start = middle + np.linalg.pinv(jacobian) @ (force - jacobian @ middle)
    basis = null_space(jacobian)
    # G·z ≥ h are the two bounds; NNLS of [Gᵀ; hᵀ] against the last unit vector leaves a residual parallel to (−z, 1)
    g = np.concatenate([basis, -basis])
    h = np.concatenate([low - start, start - high])
    target = np.append(np.zeros(basis.shape[1]), 1.0)
    weights, _ = nnls(np.vstack([g.T, h]), target)
    residual = np.vstack([g.T, h]) @ weights - target
    reached = np.allclose(jacobian @ start, force, rtol=0, atol=1e-9)
    if not reached or abs(residual[-1]) < 1e-9:
        raise ConfigError(
            f"no tensions between {low} and {high} N along these directions give {force.tolist()} N; turn the cables or widen the bounds",
            key="directions",
            directions=directions.tolist(),
        )
    return start - basis @ residual[:-1] / residual[-1]
