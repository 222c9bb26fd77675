"""Maximum-likelihood fit of A and B of the model whose noise grows with the joint speed."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from numpy import ndarray

from pipeline.core import validation
from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models import steps as base
from pipeline.models.model import principal_axes, root, without_measurement
from pipeline.models.steps import Estimate, Recorded, Truth

FLAT = 1e-5  # greatest slope at a minimum, by an entry of L or along X + tN, ‖N‖ = 1
SEARCHES = 20
SEARCH = {"maxiter": 2000, "maxfun": 4000, "maxcor": 20, "ftol": 1e-14, "gtol": 1e-7}
Structure = Literal["diagonal", "full"]
# f and its symmetric derivatives by the matrices
Objective = Callable[[list[ndarray]], tuple[float, list[ndarray]]]


@validation.options(kw_only=True)
class Options(base.Options):
    """``structure``: ``diagonal`` or ``full`` covariances A and B."""

    structure: Structure


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """Estimate A and B; raises ModelDomainError and SolverError as :func:`fit_scaled`."""
    steps = recorded.chain.nominal_step(recorded.q, recorded.v)
    floor, gain, _ = fit_scaled(recorded.noise, steps, recorded.measurement, options.structure)
    return _estimate(floor, gain, recorded.joints)


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """Parameters with half of the recorded variance from A and half from B."""
    covariance = base.mean_covariance(recorded.noise)
    square = np.mean(recorded.chain.nominal_step(recorded.q, recorded.v) ** 2, axis=(0, 1))
    kept = np.diag(np.diag(covariance)) if options.structure == "diagonal" else covariance
    gain = kept / np.sqrt(np.outer(square, square)) / 2
    known = _estimate(kept / 2, gain, recorded.joints)
    return [Truth(f"scaled {options.structure}", known.parameters, known.estimates)]


def _estimate(floor: ndarray, gain: ndarray, joints: tuple[str, ...]) -> Estimate:
    named = ("std_at_rest", "_rad", floor), ("std_share_of_the_step", "", gain)
    values = {
        f"{name}_{joint}{unit}": std
        for name, unit, matrix in named
        for joint, std in zip(joints, np.sqrt(np.diag(matrix)), strict=True)
    }
    parameters = {"kind": "scaled", "floor": floor.tolist(), "gain": gain.tolist()}
    return Estimate(parameters, values, {})


def fit_scaled(
    noise: ndarray, dq: ndarray, measurement: ndarray, structure: Structure
) -> tuple[ndarray, ndarray, float]:
    """Fit A ⪰ 0 in rad² and B ⪰ 0 (n, n) to ω ~ N(0, Σ_m + A + D(q̇)BD(q̇)) by maximum likelihood;
    return both and the mean log likelihood of a step in nats (rad⁻ⁿ).

    ``noise`` ω and ``dq``, nominal steps of the joints, are (takes, M, n) in rad, Σ_m (n, n) in
    rad². Raises ModelDomainError if the likelihood is not bounded or a joint never moves,
    SolverError if the search does not end at an optimum.
    """
    _ = principal_axes(measurement)  # raises if it is no covariance
    n = noise.shape[-1]
    w, x = noise.reshape(-1, n), dq.reshape(-1, n)
    rest = ~np.any(x, axis=-1)
    for group in (w, w[rest]) if np.any(rest) else (w,):  # at rest B has no effect
        _require_bounded_density(group, measurement)
    # the search uses the rms noise and the rms step of a joint as its units
    scale, speed = np.sqrt(np.diag(w.T @ w / len(w))), np.sqrt(np.mean(x**2, axis=0))
    if not np.all(speed > 0):
        message = "noise that grows with speed cannot be determined where a joint never moves"
        raise ModelDomainError(message, rms_step=speed.tolist())
    outer = np.outer(scale, scale)
    each = [np.eye(n)[:, [j]] for j in range(n)] if structure == "diagonal" else [np.eye(n)]
    directions, half = 2 * each, len(each)  # P of A = ΣPXPᵀ, X ⪰ 0, then P of B
    unit_noise, unit_speed, added = (w / scale).T.copy(), (x / speed).T.copy(), measurement / outer

    def covariances(matrices: list[ndarray]) -> tuple[ndarray, ndarray]:
        parts = [p @ matrix @ p.T for p, matrix in zip(directions, matrices, strict=True)]
        return sum(parts[:half]), sum(parts[half:])

    def loss(matrices: list[ndarray]) -> tuple[float, list[ndarray]]:
        floor, gain = covariances(matrices)
        value, *slopes = negative_log_likelihood(unit_noise, unit_speed, floor + added, gain)
        return value, [p.T @ slope @ p for slope in slopes for p in directions[:half]]

    # start: half of the variance from A, half from B at the rms speeds of the joints
    matrices, value = minimise(loss, [0.5 * np.eye(p.shape[1]) for p in directions])
    floor, gain = covariances(matrices)
    log_likelihood = -value - 0.5 * n * np.log(2 * np.pi) - np.log(scale).sum()
    return floor * outer, gain * outer / np.outer(speed, speed), float(log_likelihood)


def _require_bounded_density(noise: ndarray, measurement: ndarray) -> None:
    """Raise ModelDomainError if the second moment of ``noise`` (N, n) plus Σ_m is singular."""
    total = noise.T @ noise / len(noise) + measurement
    scale = np.sqrt(np.diag(total))
    regular = np.all(np.isfinite(scale)) and np.all(scale > 0)
    if not (regular and np.linalg.eigvalsh(total / np.outer(scale, scale))[0] > 1e-12):
        message = "the recorded noise lies in a plane or is not finite: the likelihood is unbounded"
        raise ModelDomainError(message, std=scale.tolist())


def negative_log_likelihood(
    w: ndarray, x: ndarray, floor: ndarray, gain: ndarray
) -> tuple[float, ndarray, ndarray]:
    """−mean ln N(w; 0, Σ) up to a constant, Σ = F + D(x)BD(x), and its derivatives (n, n) by F and
    B; infinite if a Σ is singular. ``w`` and ``x`` (n, N) are noise and speeds of N steps. F (n, n)
    includes Σ_m. With Σ = LLᵀ the derivative by Σ is Σ⁻¹ − (Σ⁻¹w)(Σ⁻¹w)ᵀ, computed entry by entry
    over all steps at once.
    """
    n, count = w.shape
    lower, inverse = np.zeros((2, n, n, count))
    value, by_floor, by_gain = 0.0, np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            entry = floor[i, j] + gain[i, j] * x[i] * x[j]
            for k in range(j):
                entry -= lower[i, k] * lower[j, k]
            if j < i:
                lower[i, j] = entry * inverse[j, j]
        if not np.all(entry > 0):
            return np.inf, by_floor, by_gain
        value += np.log(entry).sum()
        inverse[i, i] = 1 / np.sqrt(entry)
        for j in range(i):
            entry = -sum(lower[i, k] * inverse[k, j] for k in range(j, i))
            inverse[i, j] = entry * inverse[i, i]
    white = [sum(inverse[i, j] * w[j] for j in range(i + 1)) for i in range(n)]
    value += sum((each * each).sum() for each in white)
    whitened = [sum(inverse[k, i] * white[k] for k in range(i, n)) for i in range(n)]
    for i in range(n):
        for j in range(i + 1):
            slope = sum(inverse[k, i] * inverse[k, j] for k in range(i, n))
            slope = slope - whitened[i] * whitened[j]
            by_floor[i, j] = by_floor[j, i] = slope.sum()
            by_gain[i, j] = by_gain[j, i] = (slope * x[i] * x[j]).sum()
    return 0.5 * value / count, 0.5 * by_floor / count, 0.5 * by_gain / count


def minimise(objective: Objective, matrices: Sequence[ndarray]) -> tuple[list[ndarray], float]:
    """Return positive semidefinite matrices at a local minimum of ``objective`` f, and the value of
    f. The search starts at ``matrices`` (k, k), of order 1, where f is finite.

    A quasi-Newton search in L, X = LLᵀ, needs no constraint (Burer and Monteiro 2003): ∂f/∂L = 2GL
    for G = ∂f/∂X. At a minimum GX = 0 and G ⪰ 0. A singular L may be stationary without G ⪰ 0: if G
    has a negative part −N, f decreases along X + tN, and the search continues along it. Raises
    SolverError if the search does not end at a minimum.
    """
    from scipy.optimize import minimize

    sizes = [len(matrix) for matrix in matrices]
    ends = np.cumsum([size**2 for size in sizes])[:-1]

    def split(theta: ndarray) -> list[ndarray]:
        parts = zip(np.split(theta, ends), sizes, strict=True)
        return [entries.reshape(size, size) for entries, size in parts]

    def in_factors(theta: ndarray) -> tuple[float, ndarray]:
        factors = split(theta)
        value, slopes = objective([factor @ factor.T for factor in factors])
        parts = zip(slopes, factors, strict=True)
        return value, np.concatenate([2 * (slope @ factor).ravel() for slope, factor in parts])

    matrices = list(matrices)
    for _ in range(SEARCHES):
        start = np.concatenate([root(matrix).ravel() for matrix in matrices])
        result = minimize(in_factors, start, jac=True, method="L-BFGS-B", options=SEARCH)
        # not result.success: the line search may stop at rounding errors
        steepest = float(np.abs(result.jac).max())
        if not (steepest < FLAT and np.isfinite(result.fun)):
            break
        matrices = [factor @ factor.T for factor in split(result.x)]
        slopes = objective(matrices)[1]
        falls = [without_measurement(-(slope + slope.T) / 2, 0.0)[0] for slope in slopes]
        size = max(np.linalg.norm(fall, 2) for fall in falls)
        for step in 0.5 ** np.arange(50) / size if size >= FLAT else ():
            tried = [matrix + step * fall for matrix, fall in zip(matrices, falls, strict=True)]
            if objective(tried)[0] < result.fun:
                matrices = tried
                break
        else:  # f decreases in no direction by more than rounding
            return matrices, float(result.fun)
    message = "the search over positive semidefinite matrices did not end at a minimum"
    raise SolverError(f"{message}: {result.message}", slope=steepest)
