"""Maximum-likelihood fit of the noise that grows with the joint speed (:mod:`pipeline.motion.scaled`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from pipeline.compiled import compiled
from pipeline.errors import ModelDomainError
from pipeline.motion.additive_fit import fit_additive, second_moment
from pipeline.motion.density import principal_axes
from pipeline.motion.semidefinite import minimise

Structure = Literal["diagonal", "full", "timing"]
SUMMED = 256  # steps


@dataclass(frozen=True)
class ScaledFit:
    """Maximum of the likelihood; log likelihoods are means per step in nats, of densities in rad⁻³."""

    floor: np.ndarray  # (3, 3) A, rad²
    gain: np.ndarray  # (3, 3) B, 1
    log_likelihood: float
    additive_log_likelihood: float  # of the additive model fitted to the same noise


def fit_scaled(noise: np.ndarray, dq: np.ndarray, measurement: np.ndarray, structure: Structure) -> ScaledFit:
    """A ⪰ 0 and B ⪰ 0 of greatest likelihood for ``noise`` ω (takes, M, 3) in rad, ω ~ N(0, Σ), Σ = Σ_m + A + D(q̇)BD(q̇), at every step.

    ``dq`` q̇ (takes, M, 3) nominal steps of the joints in rad, ``measurement`` Σ_m (3, 3) in rad². ω is taken as it is: no model of the
    step has a mean of its own. ``structure``: ``diagonal`` A and B diagonal, ``full`` neither, ``timing`` A full and B = σ_ε²·11ᵀ. Of all
    these A is a sum of PXPᵀ, X ⪰ 0, and so is B; with G = ½(Σ⁻¹ − Σ⁻¹ωωᵀΣ⁻¹) the slope by X is Pᵀ·mean(G)·P in A and
    Pᵀ·mean(D(q̇)GD(q̇))·P in B. Any of them may be singular or zero at the maximum.

    Raises ModelDomainError where the likelihood has no bound (no measurement noise, and noise at rest that is zero or lies in a plane)
    or where a joint never moves, SolverError where the search does not end at an optimum.
    """
    if structure not in get_args(Structure):
        raise ModelDomainError(f"the structure must be one of {get_args(Structure)}", structure=structure)
    _ = principal_axes(measurement)  # refuses what is not a covariance
    w, x = noise.reshape(-1, 3), dq.reshape(-1, 3)
    # each joint in units of its own noise and its own speed, as a search needs it
    scale, speed = np.sqrt(np.diag(second_moment(w, measurement))), np.sqrt(np.mean(x**2, axis=0))
    if not np.all(speed > 0):
        raise ModelDomainError("noise that grows with speed cannot be told where a joint never moves", rms_step=speed.tolist())
    rest = ~np.any(x, axis=-1)
    if np.any(rest):
        _ = second_moment(w[rest], measurement)  # refuses noise to which a singular floor would give a density without bound
    outer = np.outer(scale, scale)
    of_floor, of_gain = _directions(structure, speed / scale)
    # in one order in memory, whatever that of the noise, so that one form of the sums is compiled
    unit_noise, unit_speed, added = np.divide(w, scale, order="C"), np.divide(x, speed, order="C"), measurement / outer

    def covariances(matrices: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        parts = [p @ matrix @ p.T for p, matrix in zip(of_floor + of_gain, matrices, strict=True)]
        return sum(parts[: len(of_floor)]), sum(parts[len(of_floor) :])

    def loss(matrices: list[np.ndarray], _: np.ndarray) -> tuple[float, list[np.ndarray], np.ndarray]:
        floor, gain = covariances(matrices)
        value, by_floor, by_gain = negative_log_likelihood(unit_noise, unit_speed, floor + added, gain)
        return value, [*(p.T @ by_floor @ p for p in of_floor), *(p.T @ by_gain @ p for p in of_gain)], np.empty(0)

    # half of the noise's variances at rest, half at the joints' usual speeds
    found = minimise(loss, [0.5 * np.eye(p.shape[1]) for p in of_floor + of_gain])
    floor, gain = covariances(found.matrices)
    log_likelihood = -found.value - 1.5 * np.log(2 * np.pi) - np.log(scale).sum()
    additive = fit_additive(noise, measurement).log_likelihood
    return ScaledFit(floor * outer, gain * outer / np.outer(speed, speed), float(log_likelihood), additive)


def negative_log_likelihood(w: np.ndarray, x: np.ndarray, floor: np.ndarray, gain: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """−mean ln N(w; 0, Σ) but for its constant, Σ = F + D(x)BD(x), and its slopes (3, 3) by F and by B; infinite where a Σ is singular.

    ``w`` (N, 3) the steps' noise, ``x`` (N, 3) their speeds, ``floor`` F (3, 3) the measurement's covariance included, ``gain`` B (3, 3).
    """
    by_floor, by_gain = np.zeros((2, 3, 3))
    total = _add_up(w, x, floor, gain, by_floor, by_gain, *np.empty((4, 3, 3)), np.empty(3))
    return 0.5 * total / len(w), 0.5 * by_floor / len(w), 0.5 * by_gain / len(w)


@compiled()
def _add_up(
    w: np.ndarray, x: np.ndarray, floor: np.ndarray, gain: np.ndarray, by_floor: np.ndarray, by_gain: np.ndarray, covariance: np.ndarray,
    precision: np.ndarray, of_floor: np.ndarray, of_gain: np.ndarray, white: np.ndarray,
) -> float:  # fmt: skip
    """Of :func:`negative_log_likelihood` what is halved and divided by N; the slopes are added to ``by_floor`` and ``by_gain``; the rest is
    room, of (3, 3) and (3,).

    Σ⁻¹ is had from cofactors, one step after the other: nothing of the steps' number is written to memory. The loops over three numbers
    stand for array expressions, which take longer to compile than all the rest.
    """
    total = 0.0
    # sums of SUMMED steps are added up, so that rounding does not grow with the number of steps
    for start in range(0, len(w), SUMMED):
        value = 0.0
        for i in range(3):
            for j in range(3):
                of_floor[i, j] = of_gain[i, j] = 0.0
        stop = start + SUMMED if start + SUMMED < len(w) else len(w)
        for n in range(start, stop):
            for i in range(3):
                for j in range(3):
                    covariance[i, j] = floor[i, j] + gain[i, j] * x[n, i] * x[n, j]
            for i in range(3):
                i1, i2 = (i + 1) % 3, (i + 2) % 3
                for j in range(3):
                    j1, j2 = (j + 1) % 3, (j + 2) % 3
                    precision[i, j] = covariance[i1, j1] * covariance[i2, j2] - covariance[i1, j2] * covariance[i2, j1]
            determinant = covariance[0, 0] * precision[0, 0] + covariance[0, 1] * precision[0, 1] + covariance[0, 2] * precision[0, 2]
            if not determinant > 0:
                return np.inf
            value += np.log(determinant)
            for i in range(3):
                for j in range(3):
                    precision[i, j] /= determinant
                white[i] = precision[i, 0] * w[n, 0] + precision[i, 1] * w[n, 1] + precision[i, 2] * w[n, 2]
                value += w[n, i] * white[i]
            for i in range(3):
                for j in range(3):
                    slope = precision[i, j] - white[i] * white[j]
                    of_floor[i, j] += slope
                    of_gain[i, j] += slope * x[n, i] * x[n, j]
        total += value
        for i in range(3):
            for j in range(3):
                by_floor[i, j] += of_floor[i, j]
                by_gain[i, j] += of_gain[i, j]
    return total


def _directions(structure: Structure, ratio: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The P (3, k) of A and those of B; ``ratio`` (3,) one unit of ε in units of each joint's noise."""
    each, whole = [np.eye(3)[:, [j]] for j in range(3)], [np.eye(3)]
    common = [(ratio / np.linalg.norm(ratio) * np.sqrt(3))[:, None]]
    return {"diagonal": (each, each), "full": (whole, whole), "timing": (whole, common)}[structure]
