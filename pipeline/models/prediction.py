"""One-step predictions of a motion model, scored by the poses that were measured, the measurement
noise added to the model's step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from pipeline.core import rng
from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.models.draws import draw_steps
from pipeline.models.kinds import estimate
from pipeline.models.model import MotionModel
from pipeline.models.options import Options
from pipeline.models.steps import Recorded
from pipeline.statistics.scores import (
    energy_score,
    log_determinant,
    nees,
    normal_energy_score,
    normal_log_score,
)

Steps = dict[str, np.ndarray]  # score → its values at the steps of a take
ENSEMBLE = 50  # draws per step for the energy score, whose estimate is unbiased for any number


def score_take(
    trial: tuple[str, int],
    takes: Mapping[int, tuple[str, np.ndarray]],
    recorded: Recorded,
    models: Mapping[str, MotionModel | Options],
    seed: int,
) -> tuple[Steps, dict[str, str]]:
    """The scores of the steps of one take under a fitted model, or, where there are options of one,
    under their fit to the other takes, and why some are missing; no scores without such a fit.

    Args:
        trial: name of the model, number of the take.
        takes: names and poses (M+1, n) in rad by number.
        recorded: what the models are fitted to; where one is fitted here, the ``takes``.
        models: by name.
        seed: of the draws.
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
    reasons: dict[str, str] = {}

    def existing(what: str, shape: tuple, values: Callable[[], np.ndarray]) -> np.ndarray:
        try:
            return values()
        except ModelDomainError as error:
            reasons[what] = str(error)
            return np.full(shape, np.nan)

    scores = {
        "log_density": existing(
            "log density",
            moving.shape,
            lambda: model.log_density(chain, q, v, q_next, measurement),
        ),
        "log_density_noiseless": np.full(moving.shape, np.nan),
        "energy": _energy(model, recorded, q, q_next, rng),
    }
    scores["log_density_noiseless"][moving] = existing(
        "log density without measurement noise",
        (moving.sum(),),
        lambda: model.log_density(chain, q[moving], v[moving], q_next[moving]),
    )
    covariance = existing(
        "mean and covariance",
        (*q.shape, q.shape[-1]),
        lambda: model.covariance(chain, q, v) + measurement,
    )
    if "mean and covariance" in reasons:
        scores["z"] = np.full(q.shape, np.nan)
        scores["nees"] = scores["log_determinant"] = np.full(moving.shape, np.nan)
        return scores, reasons
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
    return {
        "z": _standardised(error, covariance),
        "nees": nees(error, covariance),
        "log_determinant": log_determinant(covariance),
    }


def _energy(
    model: MotionModel,
    recorded: Recorded,
    q: np.ndarray,
    q_next: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    shape, n = (ENSEMBLE, *q.shape), q.shape[-1]
    drawn, _ = draw_steps(model, recorded.chain, np.broadcast_to(q, shape), recorded.v, rng)
    noise = rng.multivariate_normal(np.zeros(n), recorded.measurement, shape[:-1])
    return energy_score(drawn + noise, q_next)


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
