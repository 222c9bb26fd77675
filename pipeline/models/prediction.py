"""One-step predictions of a motion model, scored by the poses that were measured, and its process
noise at the recorded poses; the measurement noise is added to the model's step.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pipeline.core import rng
from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.models.draws import draw_steps
from pipeline.models.kinds import estimate
from pipeline.models.model import MotionModel
from pipeline.models.options import Options
from pipeline.models.steps import Recorded, at_recorded_level
from pipeline.statistics.curves import ModelledNoise
from pipeline.statistics.scores import (
    energy_score,
    log_determinant,
    nees,
    normal_energy_score,
    normal_log_score,
)

Steps = dict[str, np.ndarray]  # score → its values at the steps of a take
DRAWS = 1000  # of a step's process noise, over the poses of all takes
ENSEMBLE = 50  # draws per step for the energy score, whose estimate is unbiased for any number


def score_take(
    trial: tuple[str, int],
    takes: Mapping[int, tuple[str, np.ndarray]],
    recorded: Recorded,
    models: Mapping[str, MotionModel | Options],
    seed: int,
) -> tuple[Steps, dict[str, str]]:
    """Scores of the steps of one take, ``trial`` the name of a model and the number of the take,
    under a fitted model or, where ``models`` has options of one, under their fit to the other
    takes; why some scores are missing. There are no scores without such a fit.

    ``takes`` has names and poses (M+1, n) in rad by number; ``recorded`` is what the models are
    fitted to; ``seed`` is of the draws.
    """
    name, number = trial
    model, (take, poses) = models[name], takes[number]
    if isinstance(model, Options):
        recorded = recorded.subset(np.delete(np.arange(len(recorded.q)), number))
        try:
            model = estimate(recorded, model).model
        except ModelDomainError as error:
            return {}, {"fit to the other takes": error.message}
    stream = rng.stream(seed, f"evaluate.{name}", number)
    try:
        return score_steps(model, recorded, poses, stream)
    except SingularJacobianError as error:
        raise SingularJacobianError(error.message, **error.evidence | {"take": take}) from None


def score_steps(
    model: MotionModel, recorded: Recorded, poses: np.ndarray, rng: np.random.Generator
) -> tuple[Steps, dict[str, str]]:
    """Scores (M,) by name of the steps between the measured ``poses`` (M+1, n) in rad of one take
    under the commands of ``recorded``, whose Σ_m is added; why the missing ones are missing.

    The scores: ``log_density`` in ln rad⁻ⁿ with Σ_m, and ``log_density_noiseless`` without, a gap
    at rest; the ``energy`` score in rad; the error ``z`` (M, n) in standard deviations of the
    prediction, its ``nees``, and the ``log_determinant`` of the covariance in ln rad²ⁿ, all three a
    gap where the model has no covariance. Raises SingularJacobianError.
    """
    chain, v, measurement = recorded.chain, recorded.v, recorded.measurement
    q, q_next, moving = poses[:-1], poses[1:], np.any(v, axis=-1)
    gaps, reasons = np.full(moving.shape, np.nan), {}
    scores = {"log_density": gaps, "log_density_noiseless": gaps.copy()}
    try:
        scores["log_density"] = model.log_density(chain, q, v, q_next, measurement)
    except ModelDomainError as error:
        reasons["log density"] = str(error)
    shape = (ENSEMBLE, *q.shape)
    drawn, _ = draw_steps(model, chain, np.broadcast_to(q, shape), v, rng)
    drawn += rng.multivariate_normal(np.zeros(q.shape[-1]), measurement, shape[:-1])
    scores["energy"] = energy_score(drawn, q_next)
    try:
        steps = q[moving], v[moving], q_next[moving]
        scores["log_density_noiseless"][moving] = model.log_density(chain, *steps)
    except ModelDomainError as error:
        reasons["log density without measurement noise"] = str(error)
    try:
        covariance = model.covariance(chain, q, v) + measurement
    except ModelDomainError as error:
        reasons["mean and covariance"] = str(error)
        z = {"z": np.full(q.shape, np.nan)}
        return scores | z | dict.fromkeys(("nees", "log_determinant"), gaps), reasons
    return scores | _moments_scores(q_next - model.mean(chain, q, v), covariance), reasons


def normal_steps(error: np.ndarray, covariance: np.ndarray) -> tuple[Steps, dict[str, str]]:
    """The scores (M,) of predictions N(0, ``covariance``) (M, n, n) in rad² of ``error`` (M, n) in
    rad, those of :func:`score_steps` but without the measurement noise none; all but ``z`` are gaps
    where a covariance is singular, as a sample's of few takes is.
    """
    try:
        scores = {
            "log_density": normal_log_score(error, covariance),
            "energy": normal_energy_score(error, covariance),
        }
        return scores | _moments_scores(error, covariance), {}
    except ModelDomainError as refused:
        gaps = np.full(len(error), np.nan)
        scores = dict.fromkeys(("log_density", "energy", "nees", "log_determinant"), gaps)
        return scores | {"z": _standardised(error, covariance)}, {"log density": str(refused)}


def _moments_scores(error: np.ndarray, covariance: np.ndarray) -> Steps:
    values = nees(error, covariance), log_determinant(covariance)
    return {"z": _standardised(error, covariance), "nees": values[0], "log_determinant": values[1]}


def _standardised(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):  # where takes of encoders are all alike
        return error / np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))


def groups_by_speed(recorded: Recorded, rate: float) -> Mapping[str, np.ndarray]:
    """Groups of steps by name, each (M,) bool: all, those at rest where there are any, and thirds
    of the others by the commanded speed ‖q̇‖ of the joints in rad/s, its mean over the takes.
    """
    dq = recorded.chain.nominal_step(recorded.q, recorded.v)
    speeds = rate * np.linalg.norm(dq, axis=-1).mean(axis=0)
    moving = np.any(recorded.v, axis=-1)
    groups = {"all": np.ones_like(moving)}
    if not np.all(moving):
        groups["at rest"] = ~moving
    ends = np.quantile(speeds[moving], [0, 1 / 3, 2 / 3, 1])
    for name, low, high in zip(("slow", "middle", "fast"), ends, ends[1:], strict=False):
        third = moving & (low <= speeds) & ((speeds < high) | (high == ends[-1]))
        groups[f"{name}, {low:.3g} to {high:.3g} rad/s"] = third
    return groups


def modelled_noise(
    model: MotionModel, recorded: Recorded, rng: np.random.Generator, draws: int = DRAWS
) -> ModelledNoise:
    """Process noise of ``model`` at the poses of ``recorded``, its level solved again for the
    recorded total variance; raises what :func:`pipeline.models.steps.at_recorded_level` raises.
    """
    own, chain, q, v = at_recorded_level(model, recorded), recorded.chain, recorded.q, recorded.v
    covariance = own.covariance(chain, q, v)
    takes = np.resize(np.arange(len(q)), draws)
    noise = draw_steps(own, chain, q[takes], v, rng)[0] - (q + chain.nominal_step(q, v))[takes]
    root = np.linalg.cholesky(recorded.measurement + 1e-30 * np.eye(q.shape[-1]))
    noise += rng.standard_normal(noise.shape) @ root.T
    return ModelledNoise(
        motion=np.diagonal(covariance, axis1=-2, axis2=-1).mean(axis=0),
        measurement=np.diagonal(recorded.measurement),
        error=own.mean(chain, q, v) - recorded.q_next,
        draws=noise,
    )
