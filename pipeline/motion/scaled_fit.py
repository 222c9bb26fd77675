"""Maximum-likelihood fit of the noise that grows with the joint speed (:mod:`pipeline.motion.scaled`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from pipeline.errors import ModelDomainError
from pipeline.motion.additive_fit import fit_additive, second_moment
from pipeline.motion.density import principal_axes
from pipeline.motion.semidefinite import minimise

Structure = Literal["diagonal", "full", "timing"]


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
    likelihood = _Likelihood((w / scale).T, (x / speed).T, measurement / outer)

    def covariances(matrices: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        parts = [p @ matrix @ p.T for p, matrix in zip(of_floor + of_gain, matrices, strict=True)]
        return sum(parts[: len(of_floor)]), sum(parts[len(of_floor) :])

    def loss(matrices: list[np.ndarray], _: np.ndarray) -> tuple[float, list[np.ndarray], np.ndarray]:
        value, by_floor, by_gain = likelihood.negative(*covariances(matrices))
        return value, [*(p.T @ by_floor @ p for p in of_floor), *(p.T @ by_gain @ p for p in of_gain)], np.empty(0)

    # half of the noise's variances at rest, half at the joints' usual speeds
    found = minimise(loss, [0.5 * np.eye(p.shape[1]) for p in of_floor + of_gain])
    floor, gain = covariances(found.matrices)
    log_likelihood = -found.value - 1.5 * np.log(2 * np.pi) - np.log(scale).sum()
    additive = fit_additive(noise, measurement).log_likelihood
    return ScaledFit(floor * outer, gain * outer / np.outer(speed, speed), float(log_likelihood), additive)


class _Likelihood:
    """Of the steps ``w`` (3, N) at the speeds ``x`` (3, N), the measurement's covariance ``measurement`` (3, 3) added."""

    def __init__(self, w: np.ndarray, x: np.ndarray, measurement: np.ndarray) -> None:
        self.w, self.squares, self.measurement = w, x[:, None] * x, measurement

    def negative(self, floor: np.ndarray, gain: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """−mean ln N(w; 0, Σ) but for its constant, and its slopes (3, 3) by A and B; infinite where a Σ is singular."""
        covariance = (floor + self.measurement)[:, :, None] + gain[:, :, None] * self.squares
        precision, determinant = _inverse(covariance)
        if not np.all(determinant > 0):
            return np.inf, np.zeros((3, 3)), np.zeros((3, 3))
        white = np.einsum("ijn,jn->in", precision, self.w)
        slope = (precision - white[:, None] * white) / (2 * self.w.shape[1])
        value = 0.5 * np.mean(np.log(determinant) + np.sum(self.w * white, axis=0))
        return float(value), slope.sum(axis=-1), np.sum(slope * self.squares, axis=-1)


def _inverse(symmetric: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverses (3, 3, N) and determinants (N,) of ``symmetric`` (3, 3, N) by cofactors: ten times as fast as LAPACK one by one."""
    rows = [np.cross(symmetric[(i + 1) % 3], symmetric[(i + 2) % 3], axis=0) for i in range(3)]
    adjugate = np.stack(rows)
    determinant = np.sum(symmetric[0] * adjugate[0], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return adjugate / determinant, determinant


def _directions(structure: Structure, ratio: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The P (3, k) of A and those of B; ``ratio`` (3,) one unit of ε in units of each joint's noise."""
    each, whole = [np.eye(3)[:, [j]] for j in range(3)], [np.eye(3)]
    common = [(ratio / np.linalg.norm(ratio) * np.sqrt(3))[:, None]]
    return {"diagonal": (each, each), "full": (whole, whole), "timing": (whole, common)}[structure]
