"""Commands of an arm that corrects a share of its deviation, and that share by likelihood.

Closed-loop inverse kinematics (Siciliano et al., Robotics, 2009, Sec. 3.7): in place of v a model's
law takes the command v_k + κ(x*_k − x(q_k)), κ = KΔt ∈ [0, 1]; open loop, the paper's form, is κ =
0. The path is that of the training takes' mean q̄, x*_k = x(q̄_k), and v_k = J(q̄_k)(q̄_{k+1} −
q̄_k): without noise a model whose mean step is the nominal one then stays on q̄. With more joints
than task rows the step of q̄ is commanded in the null space too, where the loop corrects nothing.

The deviation from the mean path goes to first order by

    e_{k+1} = F_k e_k + w_k,   F_k = D_k − κG_k,   y_k = e_k + b + n_k,   n ~ N(0, Σ_m/2),

with D_k = ∂E[q_{k+1}]/∂q at (q̄_k, v_k) and G_k = ∂E[q_{k+1}]/∂v·J(q̄_k) of the model's own mean.
Cov w_k is the model's own at the measured poses and commands, averaged over the takes. An estimator
that leaves the measurement's noise in the model's, as the paper's do, leaves it in here too.
Regressing the noise of a step on the deviation before it gives no κ: both hold the noise of the
same measured pose.
"""

import json
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models import kinds
from pipeline.models.model import Commands, MotionModel
from pipeline.models.normal import without_measurement
from pipeline.models.options import Options
from pipeline.models.steps import Estimate, Recorded

FOLDER, SHARE = "closed", "closed_loop_share"  # beside the open loop's parameters; κ among them
GRID = np.linspace(0.0, 1.0, 9)  # of κ, where the search begins
DIFFERENCE = 1e-3  # of κ, for the slopes of the likelihood
PERTURBATION = 1e-6  # rad, for the slopes of a model's mean
SETTLED = 0.01  # standard errors by which κ may still move
ROUNDS = 50


@dataclass(frozen=True)
class MeanPath:
    """The mean of the training takes, which the closed loop holds the arm to."""

    chain: Chain
    poses: ndarray  # (M+1, n) q̄ in rad

    @cached_property
    def v(self) -> ndarray:
        """(M, m) J(q̄_k)(q̄_{k+1} − q̄_k), with q̄_{k+1} − q̄_k beside it (M, m + n) for n > m."""
        step = np.diff(self.poses, axis=0)
        v = np.matvec(self.chain.jacobian(self.poses[:-1]), step)
        return v if v.shape == step.shape else np.concatenate([v, step], axis=-1)

    @property
    def path(self) -> ndarray:
        """(M, p) x* before each step."""
        return self.chain.pose(self.poses[:-1])

    def corrected(self, q: ndarray, share: float) -> ndarray:
        """(takes, M, ·) the commands at ``q`` (takes, M, n) in rad of the loop of ``share`` κ."""
        v = np.tile(self.v, (len(q), 1, 1))
        off = self.chain.displacement(self.chain.pose(q), self.path)
        v[..., : len(self.chain.task)] += share * off
        return v

    def commands(self, share: float) -> Commands:
        """Commands of the closed loop of this ``share`` κ."""
        return Commands(self.v, self.path, share)


def measured_poses(recorded: Recorded) -> ndarray:
    """(takes, M+1, n) rad, the poses before and after the steps of ``recorded``."""
    return np.concatenate([recorded.q, recorded.q_next[:, -1:]], axis=1)


def mean_path(recorded: Recorded) -> MeanPath:
    """Mean path of the takes of ``recorded``."""
    return MeanPath(recorded.chain, measured_poses(recorded).mean(axis=0))


def closed_loop_steps(recorded: Recorded, path: MeanPath, share: float) -> Recorded:
    """The steps of ``recorded`` as the closed loop of ``share`` κ commanded them: v of each take
    with the correction of its measured deviation, zero at rest, and the noise left. Σ_m is that of
    n_{k+1} − (I − κJ⁺J)n_k, mean over the ``path``; raises ModelDomainError where it is not known.
    """
    chain, q, each = recorded.chain, recorded.q, recorded.measurement / 2
    chain.require_regular(q, what="measured pose")
    v = path.corrected(q, share)
    noise = recorded.q_next - q - chain.nominal_step(q, v)
    v[:, ~np.any(recorded.v, axis=-1)] = 0.0
    n, poses = q.shape[-1], path.poses[:-1]
    if len(chain.task) == n:
        measurement = (1 + (1 - share) ** 2) * each
    else:
        kept = np.eye(n) - share * (chain.inverse_jacobian(poses) @ chain.jacobian(poses))
        measurement = each + (kept @ each @ np.swapaxes(kept, -1, -2)).mean(axis=0)
    return replace(recorded, v=v, noise=noise, known_measurement=measurement)


def fitted_closed_loop(folder: Path) -> tuple[MotionModel, float] | None:
    """The model and κ of the closed loop whose fit is in ``folder``; None where there is none."""
    closed = folder / FOLDER
    if not closed.is_dir():
        return None
    return kinds.fitted_model(closed), json.loads((closed / "parameters.json").read_text())[SHARE]


class ClosedLoopFit(NamedTuple):
    """κ̂ and the model in its loop."""

    share: float  # κ̂
    standard_error: float
    estimate: Estimate  # of the model's own parameters
    rounds: int  # of alternation between the two


class StateSpace(NamedTuple):
    """A linear-Gaussian law of the deviations, for any κ."""

    drift: ndarray  # (M, n, n) D_k
    correction: ndarray  # (M, n, n) G_k
    noise: ndarray  # (M, n, n) Cov w_k in rad²
    measurement: ndarray  # (n, n) Cov n_k in rad²
    moving: ndarray  # (M,) True where the step was commanded to move


def closed_loop_of(
    recorded: Recorded, options: Options, found: Estimate
) -> tuple[ClosedLoopFit | None, str]:
    """:func:`fit_closed_loop` where the ``options`` ask for it and it exists; else why not."""
    if not options.closed_loop:
        return None, "its options ask for none"
    try:
        return fit_closed_loop(recorded, options, found), ""
    except (ModelDomainError, SolverError) as error:
        return None, str(error)


def fit_closed_loop(recorded: Recorded, options: Options, found: Estimate) -> ClosedLoopFit:
    """κ̂ and the parameters by ``options``, in turn till κ̂ settles; ``found`` is the open loop's.
    Raises ModelDomainError for a single take, without a known measurement noise or a covariance,
    SolverError where the two do not settle, and what the estimator raises.
    """
    poses, path = measured_poses(recorded), mean_path(recorded)
    if len(poses) < 2:
        raise ModelDomainError("the mean path of a closed loop needs two takes", takes=len(poses))
    deviation, share, error, estimate = poses - path.poses, 0.5, inf, found
    for rounds in range(1, ROUNDS + 1):
        space = state_space(estimate.model, recorded, path, share)
        before, (share, error) = share, most_likely_share(space, deviation)
        estimate = kinds.estimate(closed_loop_steps(recorded, path, share), options)
        if abs(share - before) <= SETTLED * error:
            estimate = replace(estimate, from_takes=None, details=None)  # which no worker returns
            return ClosedLoopFit(share, error, estimate, rounds)
    raise SolverError(
        f"the share of the deviation that the loop corrects has not settled in {ROUNDS} rounds",
        share=share,
        moved=abs(share - before),
        standard_error=error,
    )


def state_space(model: MotionModel, recorded: Recorded, path: MeanPath, share: float) -> StateSpace:
    """The law of the deviations from ``path`` under ``model``, its noise in a loop of ``share`` κ;
    raises ModelDomainError where ``model`` has no mean or covariance.
    """
    chain, q, v = recorded.chain, path.poses[:-1], path.v
    jacobian, step = chain.jacobian(q), np.zeros_like(v)
    drift, correction = np.empty((2, *q.shape, q.shape[-1]))
    for j, h in enumerate(PERTURBATION * np.eye(q.shape[-1])):
        drift[..., j] = model.mean(chain, q + h, v) - model.mean(chain, q - h, v)
        step[:, : len(chain.task)] = np.matvec(jacobian, h)
        correction[..., j] = model.mean(chain, q, v + step) - model.mean(chain, q, v - step)
    noise = model.covariance(chain, recorded.q, path.corrected(recorded.q, share)).mean(axis=0)
    slopes, moving = (each / (2 * PERTURBATION) for each in (drift, correction)), recorded.v
    return StateSpace(*slopes, noise, recorded.measurement / 2, np.any(moving, axis=-1))


def most_likely_share(space: StateSpace, deviation: ndarray) -> tuple[float, float]:
    """κ̂ in [0, 1] for ``deviation`` (takes, M+1, n) in rad from the takes' mean, by Newton's steps
    from the best of a grid, and its standard error, the sandwich's over takes. Raises SolverError
    where the likelihood has no maximum there.
    """
    takes = len(deviation)
    share = float(GRID[take_log_likelihoods(space, deviation, GRID).sum(axis=1).argmax()])
    for _ in range(ROUNDS):
        around = share + DIFFERENCE * np.array([-1.0, 0.0, 1.0])
        low, middle, high = take_log_likelihoods(space, deviation, around)
        slopes = (high - low) / (2 * DIFFERENCE)
        information = float(np.sum(2 * middle - high - low)) / DIFFERENCE**2
        if not information > 0:
            raise SolverError("the likelihood of the closed loop has no maximum", share=share)
        scatter = np.sum((slopes - slopes.mean()) ** 2) * takes / (takes - 1)
        error = float(np.sqrt(scatter)) / information
        before, share = share, min(max(share + float(slopes.sum()) / information, 0.0), 1.0)
        if abs(share - before) <= 0.1 * SETTLED * error:
            return share, error
    raise SolverError("the likelihood of the closed loop was not maximised", share=share)


def take_log_likelihoods(space: StateSpace, deviation: ndarray, shares: ndarray) -> ndarray:
    """(K, takes) ln p of each take's ``deviation`` (takes, M+1, n) in rad given the first pose of
    each stretch, for each κ of ``shares`` (K,), but for a constant; −inf for a κ at which the
    determinant of an innovation's covariance is not positive.

    By the Kalman filter of (e, e + b), whose gains all takes share; nothing is assumed of b.
    Deviations from the takes' own mean are N − 1 contrasts of the takes: their covariance counts (N
    − 1)/N times for each take (restricted likelihood, Patterson and Thompson 1971).
    """
    (takes, _, n), grid = deviation.shape, len(shares)
    transition = np.tile(np.eye(2 * n), (grid, len(space.noise), 1, 1))
    transition[..., :n, :n] = space.drift - shares[:, None, None, None] * space.correction
    transition[..., n:, :n] = transition[..., :n, :n] - np.eye(n)
    added = np.tile(space.noise, (1, 2, 2))
    result, unsound = np.zeros((grid, takes)), np.zeros(grid, dtype=bool)
    for k in np.flatnonzero(space.moving):
        if k == 0 or not space.moving[k - 1]:
            mean = np.zeros((grid, takes, 2 * n))
            mean[..., n:] = deviation[:, k]
            covariance = np.zeros((grid, 2 * n, 2 * n))
            spread = deviation[:, k].T @ deviation[:, k] / (takes - 1)
            covariance[:, :n, :n], _ = without_measurement(spread, space.measurement)
            covariance[:, n:, n:] = space.measurement
        transposed = transition[:, k].swapaxes(-1, -2)
        mean, covariance = mean @ transposed, transition[:, k] @ covariance @ transposed + added[k]
        across = covariance[..., n:, :]
        total = across[..., n:] + space.measurement
        innovation = deviation[:, k + 1] - mean[..., n:]
        precision, determinant = np.linalg.inv(total), np.linalg.det(total)
        white, sound = innovation @ precision, determinant > 0
        unsound |= ~sound
        result -= 0.5 * np.vecdot(white, innovation)
        result -= 0.5 * (takes - 1) / takes * np.log(np.where(sound, determinant, 1.0))[:, None]
        mean = mean + white @ across
        covariance = covariance - across.swapaxes(-1, -2) @ precision @ across
        covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))
    result[unsound] = -np.inf
    return result
