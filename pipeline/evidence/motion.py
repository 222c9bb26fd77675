"""Evidence on fits, realisations and predictions of the motion models."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations_with_replacement, permutations, product

import numpy as np
import pandas as pd

from pipeline.arm.chain import Chain
from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.evidence.case import Takes
from pipeline.evidence.table import (
    RECORDED,
    Row,
    difference_row,
    evidence_row,
    evidence_table,
    following_rows,
)
from pipeline.models.closed_loop import ClosedLoopFit
from pipeline.models.model import MotionModel, frobenius
from pipeline.models.prediction import modelled_noise
from pipeline.models.steps import Recorded, recorded_deviation
from pipeline.recordings.commands import constant_speed
from pipeline.statistics.curves import (
    CLOSE_TO_ONE,
    NO_NOISE,
    VARYING,
    ModelledNoise,
    correlation,
    following_tests,
    jackknifed_mean_error,
    jackknifed_spreads,
    root_mean_square,
    variation,
)
from pipeline.statistics.scores import log_score_differences
from pipeline.statistics.takes import (
    NORMAL_QUANTILE,
    fast_against_slow,
    jackknife_difference,
    lag_one_correlation,
    share_between,
)

# estimates of the noise, which have entries, and of the paper's estimator, which have none
NOISE = {
    "sigma_omega": "sigma_omega_{}_rad2",
    "correlation_omega": "correlation_omega_{}",
}
PAPERS = ("sigma_b", "u", "alpha")
# drawn, and least that remain
DEXTERITY_POSES = 2000
LEAST_POSES = 20
DEXTERITY_STEP = 1e-3  # m or rad, of a task row
Rows = Iterator[Row]


@dataclass
class Outcome:
    """Fit, realisations and scores of a model; ``refusals`` are the reasons for missing ones."""

    model: MotionModel | None = None
    closed: ClosedLoopFit | None = None  # the model in a closed loop
    # by the names of fit.json
    estimates: Mapping[str, float] = field(default_factory=dict)
    mean: np.ndarray | None = None  # (M+1, n) rad, of the realisations
    deviation: np.ndarray | None = None  # (M+1, n) rad
    # (takes,) nats, of all steps and of the moving steps
    log_score: dict[str, np.ndarray] = field(default_factory=dict)
    modelled: ModelledNoise | None = None  # at the recorded total variance
    following: pd.DataFrame | None = None  # of following_tests
    refusals: list[str] = field(default_factory=list)


def noise_tests(
    model: MotionModel,
    takes: Takes,
    rng: np.random.Generator,
) -> tuple[ModelledNoise, pd.DataFrame]:
    """Return the noise of ``model`` at the recorded total variance, and the :func:`following_tests`
    of the recorded standard deviations of the training takes, the speed law being the rival.
    """
    training = takes.training
    speed_noise = takes.speed_noise
    noise = modelled_noise(model, training)
    rival = None if speed_noise is None else speed_noise.std
    steady = constant_speed(takes.poses)
    tests = following_tests(
        noise.std,
        training.noise,
        steady,
        training.joints,
        rng,
        rival=rival,
    )
    return noise, tests


def motion_evidence(
    outcomes: Mapping[str, Outcome],
    takes: Takes,
    mode: str,
    limits: np.ndarray | None,
) -> pd.DataFrame:
    """Return the evidence of fits, realisations and predictions; ``outcomes`` by model.

    ``limits`` (n, 2) are of :func:`pipeline.statistics.curves.variation_limits`; None leaves out
    the evidence on the recordings themselves.
    """
    training = takes.training
    rows = [] if limits is None else [*_recorded_rows(takes, limits)]
    for name, outcome in outcomes.items():
        rows += _estimate_rows(name, outcome.estimates, len(training.joints))
    for name, error in _mean_errors(outcomes, takes).items():
        greatest = np.linalg.norm(error, axis=-1).max()
        rows.append(evidence_row("greatest_mean_error", greatest, model=name))
    for name, curves in _deviations(outcomes, takes, mode).items():
        for joint, curve in zip(training.joints, curves.T, strict=True):
            if not np.all(np.isfinite(curve)):
                continue
            keys = {"model": name, "joint": joint}
            rows.append(evidence_row("std", root_mean_square(curve), **keys))
            rows.append(evidence_row("std_variation", variation(curve), **keys))
    compared = {name: result for name, result in outcomes.items() if result.modelled}
    if mode == "one_step" and compared:
        rows += noise_rows(compared, training)
    return evidence_table([*rows, *_score_rows(outcomes)])


def _mean_errors(
    outcomes: Mapping[str, Outcome],
    takes: Takes,
) -> dict[str, np.ndarray]:
    """Return by model the mean of its realisations minus the mean of the training takes (M, n) in
    rad, and the same of the nominal steps.
    """
    recorded = takes.poses.mean(axis=0)
    errors = {}
    for name, outcome in outcomes.items():
        if outcome.mean is not None:
            errors[name] = (outcome.mean - recorded)[1:]
    training = takes.training
    nominal = training.q + training.chain.nominal_step(training.q, training.v)
    errors[NO_NOISE] = (nominal - training.q_next).mean(axis=0)
    return errors


def _deviations(
    outcomes: Mapping[str, Outcome],
    takes: Takes,
    mode: str,
) -> dict[str, np.ndarray]:
    """Return the standard deviations over time (M, n) in rad of the recordings, and by model: of
    one step at the recorded total variance, or of free-running realisations.
    """
    recorded = recorded_deviation(takes.poses, takes.training.noise, mode)
    deviations = {RECORDED: recorded[1:]}  # without k = 0, before the first step
    for name, outcome in outcomes.items():
        if mode == "one_step":
            # a model without the recorded total variance is not compared
            if outcome.modelled:
                deviations[name] = outcome.modelled.std
        elif outcome.mean is not None:
            deviations[name] = outcome.deviation[1:]
    return deviations


def _recorded_rows(takes: Takes, limits: np.ndarray) -> Rows:
    """Yield the evidence on the training takes themselves."""
    training = takes.training
    noise = training.noise
    yield evidence_row("takes", len(noise), model=RECORDED)
    recordings = [name.rpartition("_")[0] for name in takes.names]
    share = share_between(noise, recordings)
    yield evidence_row("share_of_variance_between_recordings", share, model=RECORDED)

    steps = training.chain.nominal_step(training.q, training.v).mean(axis=0)
    ranges = np.ptp(np.cumsum(steps, axis=0), axis=0)
    by_speed = fast_against_slow(noise, steps)
    for j, joint in enumerate(training.joints):
        keys = {"model": RECORDED, "joint": joint}
        correlated = lag_one_correlation(noise[..., j])
        yield evidence_row("commanded_range", ranges[j], **keys)
        yield evidence_row("lag_one_correlation", correlated, **keys)
        yield evidence_row("std_variation_limits", VARYING, *limits[j], **keys)
        yield difference_row("ln_std_by_speed", by_speed[j], **keys)


def _estimate_rows(model: str, numbers: Mapping[str, float], joints: int) -> Rows:
    """Yield the estimates that have a published value, with their intervals if there are any."""
    places = {}
    for name in PAPERS:
        places[f"{name}_paper"] = {"quantity": name, "estimator": "paper"}
    places["u_paper_unbounded"] = {"quantity": "u_unbounded", "estimator": "paper"}
    for first, second in combinations_with_replacement(range(1, joints + 1), 2):
        entry = f"{first}{second}"
        for quantity, pattern in NOISE.items():
            places[pattern.format(entry)] = {"quantity": quantity, "entry": entry}
    for name, place in places.items():
        if name in numbers:
            low = numbers.get(f"{name}_interval_low", np.nan)
            high = numbers.get(f"{name}_interval_high", np.nan)
            yield evidence_row(
                value=numbers[name],
                low=low,
                high=high,
                model=model,
                **place,
            )


def noise_rows(outcomes: Mapping[str, Outcome], training: Recorded) -> Rows:
    """Yield the comparisons of the modelled noise with the recorded one at its total variance: of
    the relative error of its standard deviation with the first model's in the same joint, with 1
    for a prediction without noise (NO_NOISE), and with the same model's in the last joint.
    """
    for model, outcome in outcomes.items():
        yield from following_rows(
            outcome.following,
            "std_correlation",
            "std_correlation",
            model,
        )
    joints = training.joints
    modelled = {name: outcome.modelled for name, outcome in outcomes.items()}
    errors, sizes = jackknifed_spreads(modelled, training.noise)

    for joint in joints:
        yield evidence_row("std_error", 1.0, model=NO_NOISE, joint=joint)
    places = [*product(errors, enumerate(joints))]
    for model, (j, joint) in places:
        yield evidence_row("std_error", errors[model][0, j], model=model, joint=joint)
    first = next(iter(errors))
    for model, (j, joint) in places:
        rivals = {NO_NOISE: 1.0, first: errors[first][:, j]}
        rivals[joints[-1]] = errors[model][:, -1]
        for rival, rival_errors in rivals.items():
            if rival in (model, joint):
                continue
            nearer = jackknife_difference(errors[model][:, j] - rival_errors)
            keys = {"model": model, "joint": joint, "rival": rival}
            yield difference_row("std_error", nearer, **keys)
    for model, (j, joint) in places:
        wider = jackknife_difference(sizes[model][:, j])
        yield difference_row("std", wider, model=model, joint=joint, rival=RECORDED)
    yield from _mean_error_rows(modelled)


def _mean_error_rows(modelled: Mapping[str, ModelledNoise]) -> Rows:
    """Yield the variation over time of the error of each model's mean, and its differences."""
    quantity = "mean_error_variation"
    variations = {}
    for model, noise in modelled.items():
        variations[model] = jackknifed_mean_error(noise.error)
        yield evidence_row(quantity, variations[model][0], model=model)
    for model, rival in permutations(variations, 2):
        difference = variations[model] - variations[rival]
        varies_more = jackknife_difference(difference)
        yield difference_row(quantity, varies_more, model=model, rival=rival)


def dexterity_evidence(
    outcomes: Mapping[str, Outcome],
    takes: Takes,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Return for each model the correlation between ln of ‖J⁺‖ and ln of its total variance, mean
    over the directions of a task step of one size, with Fisher's interval. The poses are drawn
    within the joint limits, with ‖J⁺‖ up to the greatest of the training takes. No row for a model
    without noise, with noise that does not depend on the pose, or without a variance.
    """
    chain = takes.training.chain
    poses, norms = dexterity_poses(chain, takes.training.q, rng)
    rows = []
    if len(poses) < LEAST_POSES:
        return evidence_table(rows)
    for name, outcome in outcomes.items():
        if outcome.model is None or not outcome.model.traits.needs_jacobian:
            continue
        try:
            total = total_variances(outcome.model, chain, poses)
        except (ModelDomainError, SingularJacobianError):
            continue
        noisy = np.isfinite(total) & (total > 0)  # a bound of the norm ends the noise
        count = int(np.count_nonzero(noisy))
        if count < LEAST_POSES:
            continue
        value = correlation(np.log(norms[noisy]), np.log(total[noisy]))
        half = NORMAL_QUANTILE / np.sqrt(count - 3)
        transformed = np.arctanh(np.clip(value, -CLOSE_TO_ONE, CLOSE_TO_ONE))
        ends = np.tanh(transformed + half * np.array([-1.0, 1.0]))
        rows.append(evidence_row("dexterity_correlation", value, *ends, model=name))
    return evidence_table(rows)


def dexterity_poses(
    chain: Chain,
    recorded: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (N, n) in rad drawn within the joint limits, and their ‖J⁺‖ (N,), which is below
    the greatest of the ``recorded`` poses (..., n).
    """
    lower = np.clip(chain.lower, -np.pi, np.pi)
    upper = np.clip(chain.upper, -np.pi, np.pi)
    poses = rng.uniform(lower, upper, (DEXTERITY_POSES, len(lower)))
    poses = poses[~chain.singular(poses)]
    norms = frobenius(chain.inverse_jacobian(poses))
    greatest = frobenius(chain.inverse_jacobian(recorded)).max()
    return poses[norms < greatest], norms[norms < greatest]


def total_variances(model: MotionModel, chain: Chain, poses: np.ndarray) -> np.ndarray:
    """Return the total variance (N,) in rad² of a step of ``model`` from each of the ``poses`` (N,
    n), mean over the directions of the task.
    """
    rows = len(chain.task)
    shape = (len(poses), rows)
    variances = []
    for v in DEXTERITY_STEP * np.eye(rows):
        commands = np.broadcast_to(v, shape)
        covariance = model.covariance(chain, poses, commands)
        total = np.trace(covariance, axis1=-2, axis2=-1)
        variances.append(total)
    return np.mean(variances, axis=0)


def prediction_evidence(predictions: pd.DataFrame, pairs: pd.DataFrame) -> pd.DataFrame:
    """Return the log scores of one step ahead on held-out takes, and their paired differences, from
    the tables ``predictions`` and ``prediction_pairs``.
    """
    rows = []
    of_all_steps = predictions["steps"] == "all"
    is_log_score = predictions["score"] == "log_score"
    for score in predictions[of_all_steps & is_log_score].itertuples():
        keys = {"model": score.model, "steps": "all"}
        rows.append(evidence_row("step_log_score", score.mean, **keys))
    for pair in pairs[pairs["steps"] == "all"].itertuples():
        keys = {"model": pair.model, "rival": pair.rival, "steps": "all"}
        rows.append(difference_row("step_log_score", pair, **keys))
    return evidence_table(rows)


def _score_rows(outcomes: Mapping[str, Outcome]) -> Rows:
    """Yield the log scores of held-out steps, and their differences between any two models."""
    for steps in ("all", "moving"):
        scored = {}
        for name, outcome in outcomes.items():
            if steps in outcome.log_score:
                scored[name] = {"log_score": outcome.log_score[steps]}
        for name, scores in scored.items():
            mean = scores["log_score"].mean()
            yield evidence_row("step_log_score", mean, model=name, steps=steps)
        for pair in log_score_differences(scored).itertuples():
            keys = {"model": pair.model, "rival": pair.rival, "steps": steps}
            yield difference_row("step_log_score", pair, **keys)
