"""Scores of joint error laws on held-out motions: every law is fitted to all motions but one and
scored on that one, at three horizons. Of a single motion, quarters of the runs are held out.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.special import ndtri

from pipeline.core.delays import delayed_angles
from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_error.choice import LAST_VALUE, QUARTER, chosen_law
from pipeline.models.joint_error.drive import GROWTH
from pipeline.models.joint_error.fit import Options, fit_joint_error, unfitted_law
from pipeline.models.joint_error.law import JointErrorModel
from pipeline.models.joint_error.samples import (
    HORIZONS,
    JointRun,
    horizon_samples,
    lags_of_logs,
    lasting_speeds,
)
from pipeline.models.joint_error.search import LEAST, QUARTERS

ENOUGH = 6  # held-out parts that show their variation
BLOCKS = 4  # else: blocks of each part, by time
QUANTILES = np.concatenate(
    [[0.001, 0.005], np.linspace(0.01, 0.99, 49), [0.995, 0.999]],
)
# kinds of samples
MOVING = "commanded"  # to which a joint was commanded to move
SETTLED = "settled"  # of these, not within SETTLING s of a jump of the commanded speed
RESTING = "at rest"  # not MOVING
UNKNOWN_LAG = "lag unknown"  # MOVING, at the mean lag of the other runs
HORIZON_NAMES = ("one sample", *(f"{duration:g} s" for duration in HORIZONS[1:]))
DRAWN = 400  # about the number of drawn samples of a run
LEAST_VARIANCE = 1e-300  # rad², of errors that never change
# significant digits of a score; the standard error of a block is in the third
DIGITS = 6
Row = dict[str, object]
MapTrials = Callable[[Callable, Sequence], Iterable]


class Split(NamedTuple):
    """Runs of which a part is held out."""

    fitted: list[JointRun]  # runs of the other parts
    scored: list[JointRun]  # runs of the part


def parts_of(runs: Sequence[JointRun]) -> dict[str, Split]:
    """Part that is held out → its split. A part is a motion; of a single motion, a quarter of every
    run. Raises ModelDomainError if no other runs have LEAST samples.
    """
    if len({run.motion for run in runs}) == 1:
        runs = quarters_of(runs)
    parts = {}
    for name in dict.fromkeys(run.motion for run in runs):
        fitted = [run for run in runs if run.motion != name]
        if sum(len(run.command) for run in fitted) >= LEAST:
            scored = [run for run in runs if run.motion == name]
            parts[name] = Split(fitted, scored)
    if not parts:
        raise ModelDomainError(
            "the runs are too short to fit a law to a part of them and score it on the rest: "
            "record longer motions",
            samples=sum(len(run.command) for run in runs),
            required=2 * LEAST,
        )
    return parts


def quarters_of(runs: Sequence[JointRun]) -> list[JointRun]:
    """Return the quarters of the ``runs`` as runs of four motions."""
    quarters = []
    for run in runs:
        ends = np.linspace(0, len(run.command), QUARTERS + 1).astype(int)
        for number, (first, end) in enumerate(pairwise(ends), 1):
            if first == end:
                continue
            quarter = replace(
                run,
                command=run.command[first:end],
                measured=run.measured[first:end],
                motion=f"{QUARTER} {number}",
            )
            quarters.append(quarter)
    return quarters


def of_first_motions(runs: Sequence[JointRun], count: int | None) -> list[JointRun]:
    """Return the ``runs`` of the first ``count`` motions; all runs for None."""
    motions = [*dict.fromkeys(run.motion for run in runs)][:count]
    return [run for run in runs if run.motion in motions]


def held_out(
    runs: Sequence[JointRun],
    laws: Mapping[str, Options],
    map_trials: MapTrials = map,
) -> dict[str, pd.DataFrame]:
    """Score the ``laws`` on the held-out parts of ``runs``; ``map_trials`` maps a function over
    trials.

    Returns ``joint_scores``: a row for each model, held-out motion, joint, horizon and kind of
    samples, also of the last value (:func:`last_values`);
    ``noise_quantiles``: standardised errors of one commanded sample; ``held_out_parameters``: the
    numbers of each law fitted without a motion; and ``held_out_run``: predictions of the longest
    run of the first held-out motion (:func:`run_predictions`).
    """
    parts = parts_of(runs)
    trials = list(product([*laws, LAST_VALUE], parts))
    results = map_trials(partial(_score_part, laws=laws, parts=parts), trials)
    first_motion = next(iter(parts))
    longest = max(parts[first_motion].scored, key=lambda run: len(run.command))
    rows = []
    parameters = []
    predictions = []
    standard: dict[str, list[list[ndarray]]] = {}
    for (model, motion), result in zip(trials, results, strict=True):
        rows += [{"model": model, "motion": motion} | row for row in result.rows]
        if result.law is None:
            continue
        standard.setdefault(model, []).append(result.standard)
        numbers = law_numbers(result.law)
        parameters.append(numbers.assign(model=model, motion=motion))
        if motion == first_motion:
            predicted = run_predictions(result.law, longest)
            predictions.append(predicted.assign(model=model))
    return {
        "joint_scores": without_repeated_kind(pd.DataFrame(rows)),
        "noise_quantiles": quantile_table(standard, runs[0].joints),
        "held_out_parameters": pd.concat(parameters, ignore_index=True),
        "held_out_run": pd.concat(predictions, ignore_index=True),
    }


def without_repeated_kind(scores: pd.DataFrame) -> pd.DataFrame:
    """Return ``scores`` without the settled samples if they are all commanded samples: then no
    commanded speed jumps, and their rows repeat others.
    """
    counts = scores.groupby("samples")["count"].sum()
    if counts.get(SETTLED, 0) < counts.get(MOVING, 0):
        return scores
    return scores[scores["samples"] != SETTLED]


def run_predictions(law: JointErrorModel, run: JointRun) -> pd.DataFrame:
    """Return the error of ``run`` at about DRAWN samples with mean and standard deviation of its
    predictions in rad: a row for each joint, horizon but one sample, and time ``t`` in s.
    """
    error = run.measured - run.command
    inputs = law.inputs(run.command)
    columns = ["recording", "joint", "horizon", "t", "error", "mean", "std"]
    tables = [pd.DataFrame(columns=columns)]
    for name, steps in zip(HORIZON_NAMES, horizon_samples(law.rate), strict=True):
        if name == HORIZON_NAMES[0] or len(error) <= steps:
            continue
        outlook = law.outlook(error, inputs, steps)
        drawn = np.arange(steps, len(error), max(1, len(error) // DRAWN))
        std = np.sqrt(outlook.variance + run.quantum**2 / 12)
        for j, joint in enumerate(law.joints):
            table = {
                "recording": run.name,
                "joint": joint,
                "horizon": name,
                "t": drawn / run.rate,
                "error": error[drawn, j],
                "mean": outlook.mean[drawn - steps, j],
                "std": std[drawn - steps, j],
            }
            tables.append(pd.DataFrame(table))
    return pd.concat(tables[1:] or tables)


def quantile_table(
    standard: Mapping[str, Sequence[Sequence[ndarray]]],
    joints: Sequence[str],
) -> pd.DataFrame:
    """Return the quantiles QUANTILES of the ``standard`` errors (model → held-out parts → joints),
    beside those of the normal law.
    """
    tables = []
    for model, parts in standard.items():
        for joint, *errors in zip(joints, *parts, strict=True):
            z = np.concatenate(errors)
            drawn = np.full(len(QUANTILES), np.nan)
            if len(z):
                drawn = np.quantile(z, QUANTILES)
            columns = {"normal": ndtri(QUANTILES), "noise": drawn}
            tables.append(pd.DataFrame({"model": model, "joint": joint} | columns))
    return pd.concat(tables, ignore_index=True)


class PartScores(NamedTuple):
    """Scores of a law on a held-out part."""

    rows: list[Row]  # of joint_scores
    standard: list[ndarray]  # by joint: standardised errors of one commanded sample
    law: JointErrorModel | None  # fitted to the other runs


def _score_part(
    trial: tuple[str, str],
    *,
    laws: Mapping[str, Options],
    parts: Mapping[str, Split],
) -> PartScores:
    """Return the scores of a ``trial``: a model, and the motion that is held out."""
    model, motion = trial
    fitted, scored = parts[motion]
    blocks = 1 if len(parts) >= ENOUGH else BLOCKS
    if model == LAST_VALUE:
        rows = []
        for number, law in enumerate(last_values(fitted)):
            rows += score_runs(law, scored, blocks, horizons=[number])[0]
        return PartScores(rows, [], None)
    law = fit_joint_error(fitted, **laws[model].law())
    rows, standard = score_runs(law, scored, blocks)
    if len(lags_of_logs(fitted)) > 1:
        late = [at_lag(run, law.lag) for run in scored]
        for row in score_runs(law, late, blocks, lag_known=False)[0]:
            if row["samples"] == MOVING:
                rows.append(row | {"samples": UNKNOWN_LAG})
    return PartScores(rows, standard, law)


def last_values(runs: Sequence[JointRun]) -> list[JointErrorModel]:
    """Return for each horizon the law that predicts the last value with the standard deviation of
    that horizon in the commanded samples of ``runs``.
    """
    law = unfitted_law(runs, 0.0)
    laws = []
    for steps in horizon_samples(law.rate):
        total = np.zeros(len(law.joints))
        count = np.zeros(len(law.joints))
        for run in runs:
            error = run.measured - run.command
            change = error[steps:] - error[:-steps]
            moving = run.moving[steps:]
            total += np.sum(change**2, axis=0, where=moving)
            count += np.sum(moving, axis=0)
        variance = total / np.maximum(count, 1)
        scale = np.full((len(law.joints), len(GROWTH)), LEAST_VARIANCE)
        scale[:, 0] += variance / steps
        laws.append(replace(law, scale=scale))
    return laws


def at_lag(run: JointRun, lag: ndarray) -> JointRun:
    """Return ``run`` with its command at another ``lag`` (n,) in s than its own."""
    command = delayed_angles(run.command, run.rate * (lag - run.lag))
    return replace(run, command=command, lag=lag)


class Predictions(NamedTuple):
    """Predictions of N samples of n joints."""

    off: ndarray  # (N, n) rad, error of the predicted mean
    variance: ndarray  # (N, n) rad², predicted for the rounded angles
    score: ndarray  # (N, n) nats, log probability
    moving: ndarray  # (N, n) True at samples to which a joint was commanded to move
    calm: ndarray  # (N, n) True if no jump of the speed precedes
    block: ndarray  # (N,) number of the block of the run's time


def score_runs(
    law: JointErrorModel,
    runs: Sequence[JointRun],
    blocks: int = 1,
    *,
    horizons: Sequence[int] = range(len(HORIZONS)),
    lag_known: bool = True,
) -> tuple[list[Row], list[ndarray]]:
    """Score the predictions of ``law`` on ``runs`` at the HORIZONS of the numbers ``horizons``:
    rows by joint, horizon, kind of samples and block of the runs' time, and the standardised errors
    of one commanded sample by joint.
    """
    rows = []
    standard = [np.empty(0)] * len(law.joints)
    steps_ahead = horizon_samples(law.rate)
    for number in horizons:
        steps = steps_ahead[number]
        long = [run for run in runs if len(run.command) > steps + 1]
        if not long:
            continue
        of_runs = [_predictions(law, run, steps, blocks, lag_known) for run in long]
        together = Predictions(*map(np.concatenate, zip(*of_runs, strict=True)))
        for j, joint in enumerate(law.joints):
            moving = together.moving[:, j]
            calm = together.calm[:, j]
            kinds = {MOVING: moving, SETTLED: moving & calm, RESTING: ~moving}
            for samples, mask in kinds.items():
                place = {"joint": joint, "horizon": HORIZON_NAMES[number]}
                place["samples"] = samples
                rows += _block_rows(together, j, mask, place)
            if number == 0:
                z = together.off[:, j] / np.sqrt(together.variance[:, j])
                standard[j] = z[moving]
    return rows, standard


def _predictions(
    law: JointErrorModel,
    run: JointRun,
    steps: int,
    blocks: int,
    lag_known: bool,
) -> Predictions:
    """Return the predictions of ``run``, ``steps`` ahead, its time in ``blocks``."""
    error = run.measured - run.command
    outlook = law.outlook(error, law.inputs(run.command), steps, lag_known)
    error = error[steps:]
    return Predictions(
        off=error - outlook.mean,
        variance=outlook.variance + run.quantum**2 / 12,
        score=outlook.log_probability(error, run.quantum),
        moving=run.moving[steps:],
        calm=run.calm[steps:] & run.calm[:-steps],
        block=np.arange(len(error)) * blocks // len(error) + 1,
    )


def _block_rows(
    predictions: Predictions,
    j: int,
    mask: ndarray,
    place: Row,
) -> list[Row]:
    """Return a row for each block that has samples of joint ``j`` in ``mask`` (N,)."""
    rows = []
    for number in np.unique(predictions.block[mask]):
        inside = mask & (predictions.block == number)
        off = predictions.off[inside, j]
        variance = predictions.variance[inside, j]
        z = off / np.sqrt(variance)
        numbers = {
            "score": predictions.score[inside, j].mean(),
            "predicted_rad": np.sqrt(variance.mean()),
            "measured_rad": np.sqrt(np.mean(off**2)),
            "one_sigma": np.mean(np.abs(z) <= 1),
            "two_sigma": np.mean(np.abs(z) <= 2),
            "autocorrelation": np.nan,
        }
        if len(z) > 1:
            size = np.mean(z**2) or 1.0
            numbers["autocorrelation"] = np.mean(z[1:] * z[:-1]) / size
        row = place | {"block": int(number), "count": len(off)}
        for name, value in numbers.items():
            row[name] = float(f"{value:.{DIGITS}g}")
        rows.append(row)
    return rows


def law_numbers(law: JointErrorModel) -> pd.DataFrame:
    """Return the NUMBERS of ``law``, a row for each joint: standard deviation of an innovation at
    rest and at the greatest speed in rad, time in s in which the slowest mode falls to 1/e (NaN if
    it persists), share of the drift, and degrees of freedom (NaN if they are infinite).
    """
    step = np.diag(law.reach / law.rate)
    at_greatest_speed = law.covariance_of_joint_step(step)
    at_rest = law.covariance_of_joint_step(0 * step)
    fastest = np.einsum("jjj->j", at_greatest_speed)
    still = np.einsum("jjj->j", at_rest)
    eigenvalues = np.linalg.eigvals(law.companion())
    modes = np.abs(eigenvalues).max(axis=-1)
    decay = np.full(len(modes), np.nan)
    fading = (modes > 0) & (modes < 1 - 1e-9)
    logarithm = np.log(modes[fading])
    decay[fading] = -1 / (law.rate * logarithm)
    columns = {
        "innovation_at_rest_rad": np.sqrt(still),
        "innovation_at_greatest_speed_rad": np.sqrt(fastest),
        "decay_s": decay,
        "drift_share": law.drift,
        "degrees": np.where(np.isfinite(law.degrees), law.degrees, np.nan),
    }
    return pd.DataFrame({"joint": law.joints} | columns)


def determined_ranges(refits: pd.DataFrame) -> pd.DataFrame:
    """Return by joint the least and greatest of each number of :func:`law_numbers` in the fits
    ``refits`` without each held-out motion, as columns ``least:NUMBER`` and ``greatest:NUMBER``.
    """
    by_joint = refits.drop(columns=["model", "motion"]).groupby("joint", sort=False)
    least = by_joint.min()
    greatest = by_joint.max()
    return least.add_prefix("least:").join(greatest.add_prefix("greatest:"))


def joint_tables(
    runs: Sequence[JointRun],
    laws: Mapping[str, Options],
    unused: Mapping[str, str],
    map_trials: MapTrials = map,
) -> dict[str, pd.DataFrame]:
    """Return the tables of :func:`held_out`, of ``held_out_run`` the rows of the law of the card
    (:func:`chosen_law`, else the last law), and ``joint_parameters`` of the laws fitted to all
    ``runs``, ``motions``, ``motion_ranges`` and ``unused_recordings`` (name → reason, ``unused``).
    """
    tables = held_out(runs, laws, map_trials)
    refits = tables.pop("held_out_parameters")
    predictions = tables.pop("held_out_run")
    shown = chosen_law(tables["joint_scores"])[0] or [*laws][-1]
    unused_recordings = pd.DataFrame(unused.items(), columns=["recording", "reason"])
    return {
        **tables,
        "held_out_run": predictions[predictions["model"] == shown],
        "joint_parameters": _parameters_table(runs, laws, refits),
        "motions": _motions_table(runs),
        "motion_ranges": ranges_of_runs(runs),
        "unused_recordings": unused_recordings,
    }


def _parameters_table(
    runs: Sequence[JointRun],
    laws: Mapping[str, Options],
    refits: pd.DataFrame,
) -> pd.DataFrame:
    """Return the numbers of the ``laws`` fitted to all ``runs``, with their ranges in
    ``refits``.
    """
    tables = []
    for name, options in laws.items():
        law = fit_joint_error(runs, **options.law())
        numbers = law_numbers(law).assign(
            model=name,
            greatest_speed=law.reach,
            has_mean=np.any(law.mean_gain != 0, axis=1),
            lag_s=law.lag,
            lag_std_s=law.lag_std,
            logs=len(lags_of_logs(runs)),
        )
        ranges = determined_ranges(refits[refits["model"] == name])
        tables.append(numbers.join(ranges, on="joint"))
    return pd.concat(tables, ignore_index=True)


def _motions_table(runs: Sequence[JointRun]) -> pd.DataFrame:
    """Return for each motion the number of its takes, the most steps and the moving joints."""
    rows = []
    for name in dict.fromkeys(run.motion for run in runs):
        takes = [run for run in runs if run.motion == name]
        moved = np.any([run.moving.any(axis=0) for run in takes], axis=0)
        row = {
            "motion": name,
            "takes": len(takes),
            "steps": max(len(run.command) - 1 for run in takes),
            "moving": ", ".join(np.array(takes[0].joints)[moved]) or "none",
        }
        rows.append(row)
    return pd.DataFrame(rows)


def ranges_of_runs(runs: Sequence[JointRun]) -> pd.DataFrame:
    """Ranges of the measured poses and of the commanded joint speeds over all ``runs``."""
    tables = []
    for quantity, unit, of_runs in (
        ("pose", "rad", [run.measured for run in runs]),
        ("joint speed", "rad/s", [lasting_speeds(run) for run in runs]),
        ("error", "rad", [run.measured - run.command for run in runs]),
    ):
        values = np.concatenate(of_runs)
        columns = {
            "quantity": quantity,
            "name": runs[0].joints,
            "unit": unit,
            "least": values.min(axis=0),
            "greatest": values.max(axis=0),
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)
