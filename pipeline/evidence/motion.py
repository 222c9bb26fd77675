"""Evidence on fits, realisations and predictions of the motion models."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations_with_replacement

import numpy as np
import pandas as pd

from pipeline.evidence.case import Takes
from pipeline.evidence.table import RECORDED, difference_row, evidence_row, evidence_table
from pipeline.models.closed_loop import ClosedLoopFit
from pipeline.models.model import MotionModel
from pipeline.models.prediction import modelled_noise
from pipeline.models.steps import Recorded, recorded_deviation
from pipeline.recordings.commands import constant_speed
from pipeline.statistics.curves import (
    NO_NOISE,
    VARYING,
    ModelledNoise,
    following_tests,
    mean_error_comparison,
    root_mean_square,
    size_differences,
    spread_comparison,
    variation,
)
from pipeline.statistics.scores import score_comparison
from pipeline.statistics.takes import lag_one_correlation, share_between

# estimates of the noise, which have entries, and of the paper's estimator, which have none
NOISE = {"sigma_omega": "sigma_omega_{}_rad2", "correlation_omega": "correlation_omega_{}"}
PAPERS = ("sigma_b", "u", "alpha")
Rows = Iterator[dict[str, object]]


@dataclass
class Outcome:
    """Fit, realisations and scores of a model; ``refusals`` are the reasons for missing ones."""

    model: MotionModel | None = None
    closed: ClosedLoopFit | None = None  # the model in a closed loop
    estimates: Mapping[str, float] = field(default_factory=dict)  # by the names of fit.json
    mean: np.ndarray | None = None  # (M+1, n) rad, of the realisations
    deviation: np.ndarray | None = None  # (M+1, n) rad
    # (takes,) nats, of all steps and of the moving steps
    log_score: dict[str, np.ndarray] = field(default_factory=dict)
    modelled: ModelledNoise | None = None  # at the recorded total variance
    following: pd.DataFrame | None = None  # of following_tests
    refusals: list[str] = field(default_factory=list)


def noise_tests(
    model: MotionModel, training: Recorded, poses: np.ndarray, rng: np.random.Generator
) -> tuple[ModelledNoise, pd.DataFrame]:
    """Return the noise of ``model`` at the recorded total variance, and the :func:`following_tests`
    of the recorded standard deviations. ``poses`` (takes, M+1, n) rad are the training takes.
    """
    noise = modelled_noise(model, training)
    steady = constant_speed(poses)
    return noise, following_tests(noise.std, training.noise, steady, training.joints, rng)


def motion_evidence(
    outcomes: Mapping[str, Outcome], takes: Takes, mode: str, limits: np.ndarray
) -> pd.DataFrame:
    """Return the evidence of fits, realisations and predictions; ``outcomes`` by model.

    ``limits`` (n, 2) are of :func:`pipeline.statistics.curves.variation_limits`.
    """
    training = takes.training
    realized = {name: each for name, each in outcomes.items() if each.mean is not None}
    modelled = {name: each.modelled for name, each in outcomes.items() if each.modelled}
    std = {RECORDED: recorded_deviation(takes.poses, training.noise, mode)[1:]}
    if mode == "one_step":
        # a model without the recorded total variance is not compared
        std |= {name: each.std for name, each in modelled.items()}
    else:  # without k = 0, before the first step
        std |= {name: each.deviation[1:] for name, each in realized.items()}
    rows = [*_recorded_rows(takes, limits)]
    for name, each in outcomes.items():
        rows += _estimate_rows(name, each.estimates, len(training.joints))
    for name, each in realized.items():
        error = np.linalg.norm(each.mean - takes.poses.mean(axis=0), axis=1)[1:]
        rows.append(evidence_row("greatest_mean_error", error.max(), model=name))
    error = np.linalg.norm(_nominal_error(training).mean(axis=0), axis=-1)
    rows.append(evidence_row("greatest_mean_error", error.max(), model=NO_NOISE))
    for name, curves in std.items():
        for joint, curve in zip(training.joints, curves.T, strict=True):
            if np.all(np.isfinite(curve)):
                rows.append(evidence_row("std", root_mean_square(curve), model=name, joint=joint))
                value = variation(curve)
                rows.append(evidence_row("std_variation", value, model=name, joint=joint))
    if mode == "one_step" and modelled:
        following = {name: outcomes[name].following for name in modelled}
        rows += _noise_rows(modelled, following, training)
    return evidence_table([*rows, *_score_rows(outcomes)])


def _nominal_error(training: Recorded) -> np.ndarray:
    """Return the nominal next pose minus the measured one (takes, M, n) in rad."""
    return training.q + training.chain.nominal_step(training.q, training.v) - training.q_next


def _recorded_rows(takes: Takes, limits: np.ndarray) -> Rows:
    noise, recordings = takes.training.noise, [name.rpartition("_")[0] for name in takes.names]
    yield evidence_row("takes", len(noise), model=RECORDED)
    share = share_between(noise, recordings)
    yield evidence_row("share_of_variance_between_recordings", share, model=RECORDED)
    steps = takes.training.chain.nominal_step(takes.training.q, takes.training.v)
    ranges = np.ptp(np.cumsum(steps.mean(axis=0), axis=0), axis=0)
    for j, joint in enumerate(takes.training.joints):
        keys = {"model": RECORDED, "joint": joint}
        yield evidence_row("commanded_range", ranges[j], **keys)
        yield evidence_row("lag_one_correlation", lag_one_correlation(noise[..., j]), **keys)
        yield evidence_row("std_variation_limits", VARYING, *limits[j], **keys)


def _estimate_rows(model: str, numbers: Mapping[str, float], joints: int) -> Rows:
    """Yield the estimates that have a published value, with their intervals if there are any."""
    places = {name: {"quantity": name, "estimator": "paper"} for name in PAPERS}
    named = {f"{name}_paper": place for name, place in places.items()}
    named["u_paper_unbounded"] = {"quantity": "u_unbounded", "estimator": "paper"}
    for pair in combinations_with_replacement(range(1, joints + 1), 2):
        entry = "".join(map(str, pair))
        for quantity, pattern in NOISE.items():
            named[pattern.format(entry)] = {"quantity": quantity, "entry": entry}
    for name, place in named.items():
        if name in numbers:
            ends = {end: numbers.get(f"{name}_interval_{end}", np.nan) for end in ("low", "high")}
            yield evidence_row(value=numbers[name], model=model, **ends, **place)


def _noise_rows(
    modelled: Mapping[str, ModelledNoise], following: Mapping[str, pd.DataFrame], training: Recorded
) -> Rows:
    """Yield the comparisons of the modelled noise with the recorded one at its total variance."""
    for model, table in following.items():
        for own in table.itertuples():
            keys = {"model": model, "joint": own.joint, "steps": own.steps}
            yield evidence_row("std_correlation", own.correlation, **keys)
            yield evidence_row("std_correlation_limit", own.limit, **keys)
            yield evidence_row("std_correlation_power", own.power, **keys)
    for joint in training.joints:
        yield evidence_row("std_error", 1.0, model=NO_NOISE, joint=joint)
    table = spread_comparison(modelled, training.noise, training.joints)
    for own in table.drop_duplicates(["model", "joint"]).itertuples():
        yield evidence_row("std_error", own.error, model=own.model, joint=own.joint)
    for own in table.itertuples():
        rival = own.rival_joint if own.rival == own.model else own.rival
        yield difference_row("std_error", own, model=own.model, joint=own.joint, rival=rival)
    for model, joint, own in size_differences(modelled, training.noise, training.joints):
        yield difference_row("std", own, model=model, joint=joint, rival=RECORDED)
    table = mean_error_comparison({model: each.error for model, each in modelled.items()})
    for own in table.drop_duplicates("model").itertuples():
        yield evidence_row("mean_error_variation", own.std_over_time_rad, model=own.model)
    for own in table.itertuples():
        yield difference_row("mean_error_variation", own, model=own.model, rival=own.rival)


def _score_rows(outcomes: Mapping[str, Outcome]) -> Rows:
    """Yield the log scores of held-out steps, and their differences to the first model's."""
    for steps in ("all", "moving"):
        scored = {
            name: {"log_score": each.log_score[steps]}
            for name, each in outcomes.items()
            if steps in each.log_score
        }
        rival = next(iter(scored), "")
        for own in score_comparison(scored, rival).itertuples():
            keys = {"model": own.model, "steps": steps}
            yield evidence_row("step_log_score", own.mean, **keys)
            yield difference_row("step_log_score", own, **keys, rival=rival)
