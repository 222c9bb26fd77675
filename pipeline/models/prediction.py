"""Scores of a motion model's one-step predictions of the measured poses, and its process noise at
the recorded poses. The covariance of the measurement noise is added to the model's covariance.
"""

from collections.abc import Mapping

import numpy as np
from numpy import ndarray

from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.models.kinds import estimate
from pipeline.models.model import MotionModel
from pipeline.models.steps import Options, Recorded, at_recorded_level
from pipeline.statistics.curves import ModelledNoise
from pipeline.statistics.scores import nees, normal_log_score

Steps = dict[str, ndarray]  # score → values at the steps of a take


def score_take(
    trial: tuple[str, int],
    takes: Mapping[int, tuple[str, ndarray]],
    recorded: Recorded,
    models: Mapping[str, MotionModel | Options],
) -> tuple[Steps, dict[str, str]]:
    """Return the scores of one take as :func:`score_steps`. ``trial`` is a model's name and a
    take's index; ``takes`` maps an index to the take's name and poses (M+1, n) in rad. Options in
    ``models`` are fitted to the other takes of ``recorded``; a failed fit has no scores.
    """
    name, number = trial
    model = models[name]
    take, poses = takes[number]
    if isinstance(model, Options):
        recorded = recorded.subset(np.delete(np.arange(len(recorded.q)), number))
        try:
            model = estimate(recorded, model).model
        except (ModelDomainError, SingularJacobianError) as error:
            return {}, {"fit to the other takes": error.message}
    try:
        return score_steps(model, recorded, poses)
    except SingularJacobianError as error:
        raise SingularJacobianError(
            error.message,
            **error.evidence | {"take": take},
        ) from None


def score_steps(
    model: MotionModel,
    recorded: Recorded,
    poses: ndarray,
) -> tuple[Steps, dict[str, str]]:
    """Scores by name of the steps between the measured ``poses`` (M+1, n) in rad of one take under
    the commands of ``recorded``, with Σ_m added, and the reasons for missing (NaN) scores.

    ``log_density`` (M,) in ln rad⁻ⁿ; the error ``z`` (M, n) in predicted standard deviations and
    its ``nees`` (M,), NaN for a model without a covariance. Raises SingularJacobianError.
    """
    chain = recorded.chain
    v = recorded.v
    measurement = recorded.measurement
    q = poses[:-1]
    q_next = poses[1:]
    reasons = {}
    gaps = np.full(len(q), np.nan)
    scores = {"log_density": gaps, "z": np.full(q.shape, np.nan), "nees": gaps}
    try:
        scores["log_density"] = model.log_density(chain, q, v, q_next, measurement)
    except ModelDomainError as error:
        reasons["log density"] = str(error)
    try:
        covariance = model.covariance(chain, q, v) + measurement
        normal, refused = normal_steps(q_next - model.mean(chain, q, v), covariance)
        scores |= {"z": normal["z"], "nees": normal["nees"]}
        if refused:
            reasons["mean and covariance"] = refused["log density"]
    except ModelDomainError as error:
        reasons["mean and covariance"] = str(error)
    return scores, reasons


def normal_steps(error: ndarray, covariance: ndarray) -> tuple[Steps, dict[str, str]]:
    """Return the scores as :func:`score_steps` of ``error`` (M, n) in rad under N(0,
    ``covariance``) (M, n, n) in rad². All scores but ``z`` are NaN if a covariance is singular,
    e.g. a sample covariance of few takes.
    """
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    # all takes may be equal: zero variance
    with np.errstate(divide="ignore", invalid="ignore"):
        z = error / np.sqrt(variances)
    try:
        log_density = normal_log_score(error, covariance)
        squared = nees(error, covariance)
    except ModelDomainError as refused:
        gaps = np.full(len(error), np.nan)
        return {"z": z, "log_density": gaps, "nees": gaps}, {
            "log density": str(refused),
        }
    return {"z": z, "log_density": log_density, "nees": squared}, {}


def groups_by_speed(recorded: Recorded, rate: float) -> Mapping[str, ndarray]:
    """Masks (M,) of the steps by group: all steps, steps at rest if any, and thirds of the moving
    steps by the commanded joint speed ‖q̇‖ in rad/s, averaged over the takes.
    """
    dq = recorded.chain.nominal_step(recorded.q, recorded.v)
    speeds = rate * np.linalg.norm(dq, axis=-1).mean(axis=0)
    moving = np.any(recorded.v, axis=-1)
    groups = {"all": np.ones_like(moving)}
    if not np.all(moving):
        groups["at rest"] = ~moving
    ends = np.quantile(speeds[moving], [0, 1 / 3, 2 / 3, 1])
    for name, low, high in zip(
        ("slow", "middle", "fast"),
        ends,
        ends[1:],
        strict=False,
    ):
        third = moving & (low <= speeds) & ((speeds < high) | (high == ends[-1]))
        groups[f"{name}, {low:.3g} to {high:.3g} rad/s"] = third
    return groups


def modelled_noise(model: MotionModel, recorded: Recorded) -> ModelledNoise:
    """Process noise of ``model`` at the poses of ``recorded``, scaled to the recorded total
    variance; raises as :func:`pipeline.models.steps.at_recorded_level`.
    """
    model = at_recorded_level(model, recorded)
    chain = recorded.chain
    q = recorded.q
    v = recorded.v
    variances = np.diagonal(model.covariance(chain, q, v), axis1=-2, axis2=-1)
    return ModelledNoise(
        motion=variances.mean(axis=0),
        measurement=np.diagonal(recorded.measurement),
        error=model.mean(chain, q, v) - recorded.q_next,
    )
