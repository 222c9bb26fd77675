"""A and B of greatest likelihood of the model whose noise grows with the joint speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.core.compiled import compiled
from pipeline.core.errors import ModelDomainError
from pipeline.models.noise import mean_covariance
from pipeline.models.normal import principal_axes
from pipeline.models.scaled.options import Options, Structure
from pipeline.models.semidefinite import minimise
from pipeline.models.steps import Estimate, Recorded, Truth

SUMMED = 256  # steps


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """Estimate A and B; raises ModelDomainError and SolverError as :func:`fit_scaled`."""
    steps = recorded.chain.nominal_step(recorded.q, recorded.v)
    fit = fit_scaled(recorded.noise, steps, recorded.measurement, options.structure)
    return _estimate(fit.floor, fit.gain, recorded.joints)


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """Half of the recorded variance from speed and half at rest; ``dispersions`` do not matter."""
    covariance = mean_covariance(recorded.noise)
    square = np.mean(recorded.chain.nominal_step(recorded.q, recorded.v) ** 2, axis=(0, 1))
    kept = np.diag(np.diag(covariance)) if options.structure == "diagonal" else covariance
    gain = kept / np.sqrt(np.outer(square, square)) / 2
    known = _estimate(kept / 2, gain, recorded.joints)
    return [Truth(f"scaled {options.structure}", known.parameters, known.estimates)]


def _estimate(floor: np.ndarray, gain: np.ndarray, joints: tuple[str, ...]) -> Estimate:
    values = {
        f"{name}_{joint}{unit}": std
        for name, unit, matrix in (
            ("std_at_rest", "_rad", floor),
            ("std_share_of_the_step", "", gain),
        )
        for joint, std in zip(joints, np.sqrt(np.diag(matrix)), strict=True)
    }
    parameters = {"kind": "scaled", "floor": floor.tolist(), "gain": gain.tolist()}
    return Estimate(parameters, values, {})


@dataclass(frozen=True)
class ScaledFit:
    """Maximum of the likelihood; log likelihoods are means per step in nats, of densities in
    rad⁻ⁿ.
    """

    floor: np.ndarray  # (n, n) A, rad²
    gain: np.ndarray  # (n, n) B, 1
    log_likelihood: float


def fit_scaled(
    noise: np.ndarray, dq: np.ndarray, measurement: np.ndarray, structure: Structure
) -> ScaledFit:
    """A ⪰ 0 and B ⪰ 0 of greatest likelihood for ω ~ N(0, Σ_m + A + D(q̇)BD(q̇)) at every step.

    With G = ½(Σ⁻¹ − Σ⁻¹ωωᵀΣ⁻¹) and A a sum of PXPᵀ, X ⪰ 0, the slope by X is Pᵀ·mean(G)·P in A
    and Pᵀ·mean(D(q̇)GD(q̇))·P in B. A and B may be singular or zero at the maximum.

    Raises ModelDomainError where the likelihood has no bound (no measurement noise, and noise at
    rest that is zero or lies in a plane) or where a joint never moves, SolverError where the search
    does not end at an optimum.

    Args:
        noise: (takes, M, n) ω in rad.
        dq: (takes, M, n) nominal steps q̇ of the joints in rad.
        measurement: (n, n) Σ_m in rad².
        structure: ``diagonal`` or ``full`` A and B.
    """
    _ = principal_axes(measurement)  # raises where it is no covariance
    n = noise.shape[-1]
    w, x = noise.reshape(-1, n), dq.reshape(-1, n)
    # each joint in units of its own noise and its own speed, as a search needs it
    scale, speed = np.sqrt(np.diag(second_moment(w, measurement))), np.sqrt(np.mean(x**2, axis=0))
    if not np.all(speed > 0):
        raise ModelDomainError(
            "noise that grows with speed cannot be told where a joint never moves",
            rms_step=speed.tolist(),
        )
    rest = ~np.any(x, axis=-1)
    if np.any(rest):
        # raises where a singular floor would give the noise a density without bound
        _ = second_moment(w[rest], measurement)
    outer = np.outer(scale, scale)
    each = [np.eye(n)[:, [j]] for j in range(n)] if structure == "diagonal" else [np.eye(n)]
    directions, half = 2 * each, len(each)  # P of A, then those of B
    # in one order in memory, so that one form of the sums is compiled
    unit_noise, unit_speed, added = (
        np.divide(w, scale, order="C"),
        np.divide(x, speed, order="C"),
        measurement / outer,
    )

    def covariances(matrices: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        parts = [p @ matrix @ p.T for p, matrix in zip(directions, matrices, strict=True)]
        return sum(parts[:half]), sum(parts[half:])

    def loss(matrices: list[np.ndarray]) -> tuple[float, list[np.ndarray]]:
        floor, gain = covariances(matrices)
        value, *slopes = negative_log_likelihood(unit_noise, unit_speed, floor + added, gain)
        return value, [p.T @ slope @ p for slope in slopes for p in directions[:half]]

    # half of the noise's variances at rest, half at the joints' usual speeds
    result = minimise(loss, [0.5 * np.eye(p.shape[1]) for p in directions])
    floor, gain = covariances(result.matrices)
    log_likelihood = -result.value - 0.5 * n * np.log(2 * np.pi) - np.log(scale).sum()
    return ScaledFit(floor * outer, gain * outer / np.outer(speed, speed), float(log_likelihood))


def second_moment(noise: np.ndarray, measurement: np.ndarray) -> np.ndarray:
    """(n, n) C = mean(ωωᵀ) in rad² of ``noise`` ω (..., n).

    Raises ModelDomainError where C + Σ_m is singular or not finite, Σ_m = ``measurement`` (n, n): a
    density then has no bound.
    """
    flat = noise.reshape(-1, noise.shape[-1])
    second = flat.T @ flat / len(flat)
    total = second + measurement
    scale = np.sqrt(np.diag(total))
    if not (
        np.all(np.isfinite(scale))
        and np.all(scale > 0)
        and np.linalg.eigvalsh(total / np.outer(scale, scale))[0] > 1e-12
    ):
        raise ModelDomainError(
            "the recorded noise lies in a plane or is not finite: its density has no "
            "maximum-likelihood estimate",
            std=scale.tolist(),
        )
    return second


def negative_log_likelihood(
    w: np.ndarray, x: np.ndarray, floor: np.ndarray, gain: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """−mean ln N(w; 0, Σ) but for its constant, Σ = F + D(x)BD(x), and its slopes (n, n) by F and
    by B; infinite where a Σ is singular.

    ``w`` (N, n) the steps' noise, ``x`` (N, n) their speeds, ``floor`` F (n, n) the measurement's
    covariance included, ``gain`` B (n, n).
    """
    n = len(floor)
    by_floor, by_gain = np.zeros((2, n, n))
    buffers = *np.empty((4, n, n)), np.empty((2, n))
    total = _add_up((0.0,) * n, w, x, floor, gain, by_floor, by_gain, *buffers)
    return 0.5 * total / len(w), 0.5 * by_floor / len(w), 0.5 * by_gain / len(w)


@compiled
def _add_up(
    joints: tuple,
    w: np.ndarray,
    x: np.ndarray,
    floor: np.ndarray,
    gain: np.ndarray,
    by_floor: np.ndarray,
    by_gain: np.ndarray,
    lower: np.ndarray,
    inverse: np.ndarray,
    floor_sum: np.ndarray,
    gain_sum: np.ndarray,
    white: np.ndarray,
) -> float:
    """Sum of ln|Σ| + wᵀΣ⁻¹w over the steps; its slopes are added to ``by_floor`` and ``by_gain``.
    ``joints`` has an entry for each; the other arrays are buffers of (n, n) and (2, n).

    With Σ = LLᵀ the slope by Σ is Σ⁻¹ − (Σ⁻¹w)(Σ⁻¹w)ᵀ, Σ⁻¹ = L⁻ᵀL⁻¹. Loops over joints stand for
    array expressions, which take longer to compile than all the rest.
    """
    # the compiler knows the length of a tuple, and unrolls the loops over joints
    total, size = 0.0, len(joints)
    # sums of SUMMED steps are added up, so that rounding does not grow with the number of steps
    for start in range(0, len(w), SUMMED):
        value = 0.0
        floor_sum[:], gain_sum[:] = 0.0, 0.0
        stop = start + SUMMED if start + SUMMED < len(w) else len(w)
        for n in range(start, stop):
            for i in range(size):
                for j in range(i + 1):
                    entry = floor[i, j] + gain[i, j] * x[n, i] * x[n, j]
                    for k in range(j):
                        entry -= lower[i, k] * lower[j, k]
                    if i > j:
                        lower[i, j] = entry * inverse[j, j]
                if not entry > 0:
                    return np.inf
                value += np.log(entry)
                inverse[i, i] = 1 / np.sqrt(entry)
                for j in range(i):
                    entry = 0.0
                    for k in range(j, i):
                        entry -= lower[i, k] * inverse[k, j]
                    inverse[i, j] = entry * inverse[i, i]
                entry = 0.0
                for j in range(i + 1):
                    entry += inverse[i, j] * w[n, j]
                white[0, i] = entry
                value += entry * entry
            for i in range(size):
                entry = 0.0
                for k in range(i, size):
                    entry += inverse[k, i] * white[0, k]
                white[1, i] = entry
                for j in range(i + 1):
                    slope = -white[1, i] * white[1, j]
                    for k in range(i, size):
                        slope += inverse[k, i] * inverse[k, j]
                    floor_sum[i, j] += slope
                    gain_sum[i, j] += slope * x[n, i] * x[n, j]
        total += value
        for i in range(size):
            for j in range(size):
                p, q = (i, j) if i >= j else (j, i)
                by_floor[i, j] += floor_sum[p, q]
                by_gain[i, j] += gain_sum[p, q]
    return total
