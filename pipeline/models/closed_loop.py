"""Closed loop: commands of an arm that corrects a share κ of its deviation from a path, and the
maximum-likelihood estimate of κ.

Closed-loop inverse kinematics (Siciliano et al., Robotics, 2009, Sec. 3.7): the command is v_k +
κ(x*_k − x(q_k)), κ = KΔt ∈ [0, 1]; κ = 0 is the open loop, the paper's form. The path is the mean
q̄ of the training takes: x*_k = x(q̄_k), v_k = J(q̄_k)(q̄_{k+1} − q̄_k). Without noise, a model
whose mean step is the nominal step stays on q̄. If n > m, the command includes the null-space part
of the step of q̄, which the loop does not correct.

To first order the deviation from the mean path follows

    e_{k+1} = F_k e_k + w_k,   F_k = D_k − κG_k,   y_k = e_k + b + n_k,   n ~ N(0, Σ_m/2),

with D_k = ∂E[q_{k+1}]/∂q at (q̄_k, v_k) and G_k = ∂E[q_{k+1}]/∂v·J(q̄_k) of the model's mean. Cov
w_k is the model's covariance at the measured poses and commands, averaged over the takes. With the
paper's estimators it includes measurement noise. Regression of a step's noise on the deviation
before it does not give κ: both contain the noise of the same pose.
"""

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.arm.chain import Chain
from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models import kinds
from pipeline.models.model import (
    Commands,
    MotionModel,
    corrected_command,
    open_loop,
    without_measurement,
)
from pipeline.models.steps import Estimate, Options, Recorded

# subfolder with the closed loop's parameters, and the key of κ in its parameters.json
FOLDER = "closed"
SHARE = "closed_loop_share"
GRID = np.linspace(0.0, 1.0, 9)  # candidate κ for the start of the search
DIFFERENCE = 1e-3  # step in κ for numerical derivatives of the likelihood
PERTURBATION = 1e-6  # rad, step for numerical derivatives of a model's mean
SETTLED = 0.01  # convergence: greatest change of κ, in standard errors
ROUNDS = 50


@dataclass(frozen=True)
class MeanPath:
    """Mean of the training takes, from which the closed loop corrects deviations."""

    chain: Chain
    poses: ndarray  # (M+1, n) q̄ in rad

    @cached_property
    def v(self) -> ndarray:
        """(M, m) J(q̄_k)(q̄_{k+1} − q̄_k); for n > m followed by q̄_{k+1} − q̄_k, (M, m + n)."""
        step = np.diff(self.poses, axis=0)
        v = np.matvec(self.chain.jacobian(self.poses[:-1]), step)
        return v if v.shape == step.shape else np.concatenate([v, step], axis=-1)

    @property
    def path(self) -> ndarray:
        """(M, p) x* before each step."""
        return self.chain.pose(self.poses[:-1])

    def corrected_commands(self, q: ndarray, share: float) -> ndarray:
        """Commands (takes, M, m) or (takes, M, m + n) of the closed loop with ``share`` κ at
        measured poses ``q`` (takes, M, n) in rad.
        """
        return corrected_command(self.chain, q, self.v, self.path, share)

    def commands(self, share: float) -> Commands:
        """Commands of the closed loop with ``share`` κ."""
        return Commands(self.v, self.path, share)


def mean_path(recorded: Recorded) -> MeanPath:
    """Mean path of the takes of ``recorded``."""
    return MeanPath(recorded.chain, recorded.poses.mean(axis=0))


def closed_loop_steps(recorded: Recorded, path: MeanPath, share: float) -> Recorded:
    """Return ``recorded`` with the commands of the closed loop with ``share`` κ: v includes the
    correction of the take's measured deviation, and is zero at rest. Σ_m is the covariance of
    n_{k+1} − (I − κJ⁺J)n_k, averaged over the ``path``. ModelDomainError if Σ_m is unknown.
    """
    chain = recorded.chain
    q = recorded.q
    pose = recorded.measurement / 2
    chain.require_regular(q, what="measured pose")
    v = path.corrected_commands(q, share)
    noise = recorded.q_next - q - chain.nominal_step(q, v)
    v[:, ~np.any(recorded.v, axis=-1)] = 0.0
    n = q.shape[-1]
    poses = path.poses[:-1]
    if len(chain.task) == n:
        measurement = (1 + (1 - share) ** 2) * pose
    else:
        projection = chain.inverse_jacobian(poses) @ chain.jacobian(poses)
        left = np.eye(n) - share * projection
        measurement = pose + (left @ pose @ left.swapaxes(-1, -2)).mean(axis=0)
    return replace(recorded, v=v, noise=noise, known_measurement=measurement)


def fitted_closed_loop(folder: Path) -> tuple[MotionModel, float] | None:
    """Return the model and κ of the closed loop fitted in ``folder``, or None if it has none."""
    closed = folder / FOLDER
    if not closed.is_dir():
        return None
    parameters = json.loads((closed / "parameters.json").read_text())
    return kinds.fitted_model(closed), parameters[SHARE]


class Loop(NamedTuple):
    """Fitted model and its commands."""

    model: MotionModel
    commands: Commands


def loops_of(
    recorded: Recorded,
    model: MotionModel | None,
    closed: tuple[MotionModel, float] | None,
) -> dict[bool, Loop]:
    """Return the loops in which a model is filtered: False has the open loop of ``model``, True the
    loop of the ``closed`` model and its κ. A loop without a model is left out.
    """
    loops = {}
    if model is not None:
        loops[False] = Loop(model, open_loop(recorded.v))
    if closed is not None:
        corrected, share = closed
        loops[True] = Loop(corrected, mean_path(recorded).commands(share))
    return loops


class ClosedLoopFit(NamedTuple):
    """Estimate κ̂, and the model fitted to the steps of the loop with κ̂."""

    share: float  # κ̂
    standard_error: float
    estimate: Estimate  # of the model's parameters


class StateSpace(NamedTuple):
    """Linear-Gaussian law of the deviations, for any κ."""

    drift: ndarray  # (M, n, n) D_k
    correction: ndarray  # (M, n, n) G_k
    noise: ndarray  # (M, n, n) Cov w_k in rad²
    measurement: ndarray  # (n, n) Cov n_k in rad²
    moving: ndarray  # (M,) True where the step was commanded to move


def closed_loop_of(
    recorded: Recorded,
    options: Options,
    open_estimate: Estimate,
) -> tuple[ClosedLoopFit | None, str]:
    """Return the result of :func:`fit_closed_loop`, or None and the reason for a failed fit."""
    if not options.closed_loop:
        return None, "closed_loop is false in its options"
    try:
        return fit_closed_loop(recorded, options, open_estimate), ""
    except (ModelDomainError, SolverError) as error:
        return None, str(error)


def fit_closed_loop(
    recorded: Recorded,
    options: Options,
    open_estimate: Estimate,
) -> ClosedLoopFit:
    """Estimate κ and the model's parameters alternately, from ``open_estimate`` until κ converges.
    Raises ModelDomainError for a single take, unknown measurement noise or a model without a
    covariance, SolverError if κ does not converge, and the errors of the estimator.
    """
    poses = recorded.poses
    path = mean_path(recorded)
    if len(poses) < 2:
        raise ModelDomainError(
            "the mean path of a closed loop needs two takes",
            takes=len(poses),
        )
    deviation = poses - path.poses
    share = 0.5
    estimate = open_estimate
    for _ in range(ROUNDS):
        previous = share
        space = state_space(estimate.model, recorded, path, share)
        share, error = most_likely_share(space, deviation)
        estimate = kinds.estimate(closed_loop_steps(recorded, path, share), options)
        if abs(share - previous) <= SETTLED * error:
            estimate = replace(estimate, from_takes=None, details=None)  # not picklable
            return ClosedLoopFit(share, error, estimate)
    raise SolverError(
        f"κ has not converged in {ROUNDS} rounds",
        share=share,
        moved=abs(share - previous),
        standard_error=error,
    )


def state_space(
    model: MotionModel,
    recorded: Recorded,
    path: MeanPath,
    share: float,
) -> StateSpace:
    """Return the law of deviations from ``path`` under ``model``; the noise covariance is taken at
    the commands of the loop with ``share`` κ. ModelDomainError without a mean or covariance.
    """
    chain = recorded.chain
    q = path.poses[:-1]
    v = path.v
    jacobian = chain.jacobian(q)
    step = np.zeros_like(v)
    drift, correction = np.empty((2, *q.shape, q.shape[-1]))
    for j, h in enumerate(PERTURBATION * np.eye(q.shape[-1])):
        ahead = model.mean(chain, q + h, v)
        behind = model.mean(chain, q - h, v)
        drift[..., j] = ahead - behind
        step[:, : len(chain.task)] = np.matvec(jacobian, h)
        ahead = model.mean(chain, q, v + step)
        behind = model.mean(chain, q, v - step)
        correction[..., j] = ahead - behind
    commands = path.corrected_commands(recorded.q, share)
    return StateSpace(
        drift=drift / (2 * PERTURBATION),
        correction=correction / (2 * PERTURBATION),
        noise=model.covariance(chain, recorded.q, commands).mean(axis=0),
        measurement=recorded.measurement / 2,
        moving=np.any(recorded.v, axis=-1),
    )


def most_likely_share(space: StateSpace, deviation: ndarray) -> tuple[float, float]:
    """Maximise the likelihood of ``deviation`` (takes, M+1, n) in rad from the mean path, by Newton
    steps from the best κ of GRID. Return κ̂ in [0, 1] and its sandwich standard error over the
    takes. Raises SolverError if no maximum is found.
    """
    takes = len(deviation)
    of_grid = take_log_likelihoods(space, deviation, GRID).sum(axis=1)
    share = float(GRID[of_grid.argmax()])
    for _ in range(ROUNDS):
        around = share + DIFFERENCE * np.array([-1.0, 0.0, 1.0])
        low, middle, high = take_log_likelihoods(space, deviation, around)
        slopes = (high - low) / (2 * DIFFERENCE)
        information = float(np.sum(2 * middle - high - low)) / DIFFERENCE**2
        if not information > 0:
            message = "the likelihood of the closed loop has no maximum"
            raise SolverError(message, share=share)
        scatter = np.sum((slopes - slopes.mean()) ** 2) * takes / (takes - 1)
        error = float(np.sqrt(scatter)) / information
        previous = share
        share = min(max(share + float(slopes.sum()) / information, 0.0), 1.0)
        if abs(share - previous) <= 0.1 * SETTLED * error:
            return share, error
    message = "the likelihood of the closed loop was not maximised"
    raise SolverError(message, share=share)


def take_log_likelihoods(
    space: StateSpace,
    deviation: ndarray,
    shares: ndarray,
) -> ndarray:
    """Log-likelihoods (K, takes), up to a constant, of ``deviation`` (takes, M+1, n) in rad for
    each κ of ``shares`` (K,), given the first pose after each rest. −inf for a κ with an innovation
    covariance that is not positive definite.

    A Kalman filter of (e, e + b) computes them for an arbitrary b; all takes share the gains. The
    deviations from the mean of N takes have N − 1 degrees of freedom, so ln|covariance| has the
    weight (N − 1)/N for each take (restricted likelihood, Patterson and Thompson 1971).
    """
    takes, _, n = deviation.shape
    result = np.zeros((len(shares), takes))
    unsound = np.zeros(len(shares), dtype=bool)
    transition = _transitions(space, shares)
    added = np.tile(space.noise, (1, 2, 2))
    for k in np.flatnonzero(space.moving):
        if k == 0 or not space.moving[k - 1]:
            mean, covariance = _after_rest(space, deviation[:, k], len(shares))
        mean, covariance = _predict(mean, covariance, transition[:, k], added[k])
        innovation = deviation[:, k + 1] - mean[..., n:]
        total = covariance[..., n:, n:] + space.measurement
        precision = np.linalg.inv(total)
        determinant = np.linalg.det(total)
        unsound |= ~(determinant > 0)
        weighted = innovation @ precision
        log_determinant = np.log(np.where(determinant > 0, determinant, 1.0))
        result -= 0.5 * np.vecdot(weighted, innovation)
        result -= 0.5 * (takes - 1) / takes * log_determinant[:, None]
        mean, covariance = _condition(mean, covariance, weighted, precision)
    result[unsound] = -np.inf
    return result


def _transitions(space: StateSpace, shares: ndarray) -> ndarray:
    """(K, M, 2n, 2n) transitions of (e, e + b) for each κ of ``shares`` (K,)."""
    steps, n, _ = space.noise.shape
    identity = np.eye(2 * n)
    transition = np.tile(identity, (len(shares), steps, 1, 1))
    share = shares[:, None, None, None]
    of_deviation = space.drift - share * space.correction
    transition[..., :n, :n] = of_deviation
    transition[..., n:, :n] = of_deviation - np.eye(n)
    return transition


def _after_rest(
    space: StateSpace,
    deviation: ndarray,
    grid: int,
) -> tuple[ndarray, ndarray]:
    """Return mean (K, takes, 2n) and covariance (K, 2n, 2n), K = ``grid``, given the first measured
    ``deviation`` (takes, n) after a rest.
    """
    takes, n = deviation.shape
    mean = np.zeros((grid, takes, 2 * n))
    mean[..., n:] = deviation
    measured = deviation.T @ deviation / (takes - 1)
    covariance = np.zeros((grid, 2 * n, 2 * n))
    covariance[:, :n, :n], _ = without_measurement(measured, space.measurement)
    covariance[:, n:, n:] = space.measurement
    return mean, covariance


def _predict(
    mean: ndarray,
    covariance: ndarray,
    transition: ndarray,
    added: ndarray,
) -> tuple[ndarray, ndarray]:
    """Return mean and covariance after a step with noise of the covariance ``added``."""
    transposed = transition.swapaxes(-1, -2)
    return mean @ transposed, transition @ covariance @ transposed + added


def _condition(
    mean: ndarray,
    covariance: ndarray,
    weighted: ndarray,
    precision: ndarray,
) -> tuple[ndarray, ndarray]:
    """Return mean and covariance given a measurement of e + b, by its innovation times the
    ``precision``, ``weighted``.
    """
    n = precision.shape[-1]
    across = covariance[..., n:, :]
    covariance = covariance - across.swapaxes(-1, -2) @ precision @ across
    symmetric = 0.5 * (covariance + covariance.swapaxes(-1, -2))
    return mean + weighted @ across, symmetric
