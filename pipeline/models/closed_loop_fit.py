"""κ of the closed loop of any motion model, by marginal likelihood, and the model's own parameters
from what noise the loop leaves.

The deviation from the mean path goes to first order by

    e_{k+1} = F_k e_k + w_k,   F_k = D_k − κG_k,   y_k = e_k + b + n_k,   n ~ N(0, Σ_m/2),

with D_k = ∂E[q_{k+1}]/∂q at (q̄_k, v_k) and G_k = ∂E[q_{k+1}]/∂v·J(q̄_k) of the model's own mean
(G_k = J⁺J where that is the nominal step, I for as many joints as task rows). Cov w_k is the
model's own at the measured poses and commands, averaged over the takes; for the Wishart model that
is the normal law of the same two moments. κ enters F_k alone. An estimator that leaves the
measurement's noise in the model's, as the paper's do, leaves it in here too. Regressing the noise
of a step on the deviation before it gives no κ: both hold the noise of the same measured pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models import kinds
from pipeline.models.closed_loop import MeanPath, closed_loop_steps, mean_path, measured_poses
from pipeline.models.model import MotionModel
from pipeline.models.normal import without_measurement
from pipeline.models.options import Options
from pipeline.models.steps import Estimate, Recorded

GRID = np.linspace(0.0, 1.0, 9)  # of κ, where the search begins
DIFFERENCE = 1e-3  # of κ, for the slopes of the likelihood
PERTURBATION = 1e-6  # rad, for the slopes of a model's mean
SETTLED = 0.01  # standard errors by which κ may still move
ROUNDS = 50


@dataclass(frozen=True)
class ClosedLoopFit:
    """κ̂ and the model in its loop."""

    share: float  # κ̂
    standard_error: float
    estimate: Estimate  # of the model's own parameters
    rounds: int  # of alternation between the two


@dataclass(frozen=True)
class StateSpace:
    """A linear-Gaussian law of the deviations, for any κ."""

    drift: np.ndarray  # (M, n, n) D_k
    correction: np.ndarray  # (M, n, n) G_k
    noise: np.ndarray  # (M, n, n) Cov w_k in rad²
    measurement: np.ndarray  # (n, n) Cov n_k in rad²
    moving: np.ndarray  # (M,) whether the step was commanded to move


def closed_loop_of(
    recorded: Recorded, options: Options, found: Estimate
) -> tuple[ClosedLoopFit | None, str]:
    """:func:`fit_closed_loop` where the ``options`` ask for it and it can be had; why not."""
    if not options.closed_loop:
        return None, "its options ask for none"
    try:
        return fit_closed_loop(recorded, options, found), ""
    except (ModelDomainError, SolverError) as error:
        return None, str(error)


def fit_closed_loop(recorded: Recorded, options: Options, found: Estimate) -> ClosedLoopFit:
    """κ̂ and the parameters by the estimator of ``options``, in turn until κ̂ has settled; those in
    ``found`` are of the open loop.

    Raises ModelDomainError for a single take, where the measurement noise is not known and where
    the model has no covariance, SolverError where the two do not settle, and what the estimator
    raises.
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
    jacobian, m = chain.jacobian(q), len(chain.task)
    drift, correction = np.empty((2, *q.shape, q.shape[-1]))
    for j, h in enumerate(PERTURBATION * np.eye(q.shape[-1])):
        drift[..., j] = model.mean(chain, q + h, v) - model.mean(chain, q - h, v)
        step = np.zeros_like(v)
        step[:, :m] = np.matvec(jacobian, h)
        correction[..., j] = model.mean(chain, q, v + step) - model.mean(chain, q, v - step)
    return StateSpace(
        drift / (2 * PERTURBATION),
        correction / (2 * PERTURBATION),
        model.covariance(chain, recorded.q, path.corrected(recorded.q, share)).mean(axis=0),
        recorded.measurement / 2,
        np.any(recorded.v, axis=-1),
    )


def most_likely_share(space: StateSpace, deviation: np.ndarray) -> tuple[float, float]:
    """κ̂ in [0, 1] for ``deviation`` (takes, M+1, n) in rad from the takes' mean, and its standard
    error.

    Newton's steps from the best of a grid, kept within [0, 1]. The standard error is the sandwich's
    over takes, so it holds where the law is not quite that of the recordings; of a handful of takes
    it is rough. Raises SolverError where the likelihood has no maximum near the best of the grid.
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


def take_log_likelihoods(
    space: StateSpace, deviation: np.ndarray, shares: np.ndarray
) -> np.ndarray:
    """(K, takes) ln p of each take's ``deviation`` (takes, M+1, n) in rad given the first pose of
    each stretch, for each κ of ``shares`` (K,), but for a constant; −inf for a κ at which the
    determinant of an innovation's covariance is not positive.

    By the Kalman filter of (e, e + b), whose gains all takes share; nothing is assumed of b, and e
    has the takes' covariance at the beginning of a stretch. Deviations from the takes' own mean are
    N − 1 contrasts of the takes: their covariance counts (N − 1)/N times for each take (restricted
    likelihood, Patterson and Thompson 1971).
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
        precision = np.linalg.inv(total)
        white = innovation @ precision
        result -= 0.5 * np.vecdot(white, innovation)
        determinant = np.linalg.det(total)
        sound = determinant > 0
        result -= 0.5 * (takes - 1) / takes * np.log(np.where(sound, determinant, 1.0))[:, None]
        unsound |= ~sound
        mean = mean + white @ across
        covariance = covariance - across.swapaxes(-1, -2) @ precision @ across
        covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))
    result[unsound] = -np.inf
    return result
