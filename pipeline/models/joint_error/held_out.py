"""Scores of joint error laws on held-out motions: every law is fitted to all motions but one and
scored on that one, at three horizons. Of a single motion, quarters of the runs are held out.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise, product, starmap
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.special import ndtri

from pipeline.core.delays import delayed_angles
from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_error.choice import LAST_VALUE, QUARTER, chosen_law
from pipeline.models.joint_error.fit import Options, fit_joint_error, unfitted_law
from pipeline.models.joint_error.law import GROWTH, JointErrorModel
from pipeline.models.joint_error.samples import (
    HORIZONS,
    JointRun,
    horizon_samples,
    lags_of_logs,
    lasting_speeds,
)
from pipeline.models.joint_error.search import LEAST

QUARTERS = 4  # parts of the runs of a single motion
ENOUGH, BLOCKS = (
    6,
    4,
)  # held-out parts that show their variation; else blocks of each, by time
QUANTILES = np.concatenate(
    [[0.001, 0.005], np.linspace(0.01, 0.99, 49), [0.995, 0.999]]
)
MOVING, SETTLED, RESTING = "commanded", "settled", "at rest"
# samples to which a joint was commanded to move; those of them that are not within SETTLING s of a
# jump of the commanded speed; the others
SAMPLES = (MOVING, SETTLED, RESTING)
UNKNOWN_LAG = "lag unknown"  # commanded samples at the mean lag of the other runs
HORIZON_NAMES = ("one sample", *(f"{duration:g} s" for duration in HORIZONS[1:]))
DRAWN = 400  # about the number of drawn samples of a run
LEAST_VARIANCE = 1e-300  # rad², of errors that never change
Row = dict[str, object]
MapTrials = Callable[[Callable, Sequence], Iterable]


def parts_of(
    runs: Sequence[JointRun],
) -> dict[str, tuple[list[JointRun], list[JointRun]]]:
    """Part that is held out → the other runs, its runs. A part is a motion; of a single motion, a
    quarter of every run. Raises ModelDomainError if no other runs have LEAST samples.
    """
    if len({run.motion for run in runs}) == 1:
        quarters = []
        for run in runs:
            ends = pairwise(np.linspace(0, len(run.command), QUARTERS + 1).astype(int))
            for number, cut in enumerate(starmap(slice, ends), 1):
                if cut.start == cut.stop:
                    continue
                own = {"command": run.command[cut], "measured": run.measured[cut]}
                quarters.append(replace(run, **own, motion=f"{QUARTER} {number}"))
        runs = quarters
    parts = {}
    for name in dict.fromkeys(run.motion for run in runs):
        others = [run for run in runs if run.motion != name]
        if sum(len(run.command) for run in others) >= LEAST:
            parts[name] = others, [run for run in runs if run.motion == name]
    if not parts:
        message = "the runs are too short to fit a law to a part of them and score it on the rest: "
        found = sum(len(run.command) for run in runs)
        raise ModelDomainError(
            f"{message}record longer motions", samples=found, required=2 * LEAST
        )
    return parts


def of_first_motions(runs: Sequence[JointRun], count: int | None) -> list[JointRun]:
    """Return the ``runs`` of the first ``count`` motions; all runs for None."""
    motions = [*dict.fromkeys(run.motion for run in runs)][:count]
    return [run for run in runs if run.motion in motions]


def held_out(
    runs: Sequence[JointRun], laws: Mapping[str, Options], each: MapTrials = map
) -> dict[str, pd.DataFrame]:
    """Score the ``laws`` on the held-out parts of ``runs``; ``each`` maps a function over trials.

    Returns ``joint_scores``: a row for each model, held-out motion, joint, horizon and kind of
    samples (:data:`SAMPLES`), also of the last value (:func:`last_values`);
    ``noise_quantiles``: standardised errors of one commanded sample; ``held_out_parameters``: the
    numbers of each law fitted without a motion; and ``held_out_run``: predictions of the longest
    run of the first held-out motion (:func:`run_predictions`).
    """
    parts = parts_of(runs)
    trials = list(product([*laws, LAST_VALUE], parts))
    results = each(partial(_score_part, laws=laws, parts=parts), trials)
    rows, parameters, predictions = [], [], []
    longest = max(parts[trials[0][1]][1], key=lambda run: len(run.command))
    standard: dict[str, list[list[ndarray]]] = {}
    for (model, part), result in zip(trials, results, strict=True):
        rows += [{"model": model, "motion": part} | row for row in result.rows]
        if model in laws:
            standard.setdefault(model, []).append(result.standard)
            numbers = law_numbers(result.law).assign(model=model, motion=part)
            parameters.append(numbers)
            if part == trials[0][1]:
                predicted = run_predictions(result.law, longest)
                predictions.append(predicted.assign(model=model))
    return {
        "joint_scores": pd.DataFrame(rows),
        "noise_quantiles": quantile_table(standard, runs[0].joints),
        "held_out_parameters": pd.concat(parameters, ignore_index=True),
        "held_out_run": pd.concat(predictions, ignore_index=True),
    }


def run_predictions(law: JointErrorModel, run: JointRun) -> pd.DataFrame:
    """Return the error of ``run`` at about DRAWN samples with mean and standard deviation of its
    predictions in rad: a row for each joint, horizon but one sample, and time ``t`` in s.
    """
    error, inputs, tables = run.measured - run.command, law.inputs(run.command), []
    for name, steps in zip(
        HORIZON_NAMES[1:], horizon_samples(law.rate)[1:], strict=True
    ):
        if len(error) <= steps:
            continue
        outlook = law.outlook(error, inputs, steps)
        drawn = np.arange(steps, len(error), max(1, len(error) // DRAWN))
        std = np.sqrt(outlook.variance + run.quantum**2 / 12)
        for j, joint in enumerate(law.joints):
            columns = {
                "joint": joint,
                "horizon": name,
                "t": drawn / run.rate,
                "error": error[drawn, j],
                "mean": outlook.mean[drawn - steps, j],
                "std": std[drawn - steps, j],
            }
            tables.append(pd.DataFrame(columns).assign(recording=run.name))
    columns = ["recording", "joint", "horizon", "t", "error", "mean", "std"]
    return pd.concat(tables) if tables else pd.DataFrame(columns=columns)


def quantile_table(
    standard: Mapping[str, Sequence[Sequence[ndarray]]], joints: Sequence[str]
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


def _score_part(trial: tuple[str, str], *, laws, parts) -> PartScores:
    model, part = trial
    others, runs = parts[part]
    blocks = 1 if len(parts) >= ENOUGH else BLOCKS
    if model == LAST_VALUE:
        rows = []
        for number, law in enumerate(last_values(others)):
            rows += score_runs(law, runs, blocks, horizons=[number])[0]
        return PartScores(rows, [], None)
    law = fit_joint_error(others, **laws[model].law())
    rows, standard = score_runs(law, runs, blocks)
    if len(lags_of_logs(others)) > 1:
        late = [at_lag(run, law.lag) for run in runs]
        unknown, _ = score_runs(law, late, blocks, lag_known=False)
        rows += [
            row | {"samples": UNKNOWN_LAG}
            for row in unknown
            if row["samples"] == MOVING
        ]
    return PartScores(rows, standard, law)


def last_values(runs: Sequence[JointRun]) -> list[JointErrorModel]:
    """Return for each horizon the law that predicts the last value with the standard deviation of
    that horizon in the commanded samples of ``runs``.
    """
    law, laws = unfitted_law(runs, 0.0), []
    for steps in horizon_samples(law.rate):
        changes = []
        for run in runs:
            error = run.measured - run.command
            change = error[steps:] - error[:-steps]
            changes.append(np.where(run.moving[steps:], change, np.nan))
        squares = np.concatenate(changes) ** 2
        counts = np.maximum(np.isfinite(squares).sum(axis=0), 1)
        scale = np.zeros((len(law.joints), len(GROWTH)))
        scale[:, 0] = np.nansum(squares, axis=0) / counts / steps
        laws.append(replace(law, scale=np.maximum(scale, LEAST_VARIANCE)))
    return laws


def at_lag(run: JointRun, lag: ndarray) -> JointRun:
    """Return ``run`` with its command at another ``lag`` (n,) in s than its own."""
    command = delayed_angles(run.command, run.rate * (lag - run.lag))
    return replace(run, command=command, lag=lag)


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
    rows, standard = [], [np.empty(0)] * len(law.joints)
    steps_ahead = horizon_samples(law.rate)
    for number in horizons:
        steps = steps_ahead[number]
        scored = []
        for run in runs:
            if len(run.command) > steps + 1:
                scored.append(_score_run(law, run, steps, blocks, lag_known))
        if not scored:
            continue
        values, masks, block = (
            np.concatenate(arrays, axis=1) for arrays in zip(*scored, strict=True)
        )
        for j, joint in enumerate(law.joints):
            place = {"joint": joint, "horizon": HORIZON_NAMES[number]}
            for samples, mask in zip(SAMPLES, masks[..., j], strict=True):
                rows += _block_rows(
                    values[:, mask, j], block[0, mask], place | {"samples": samples}
                )
            if number == 0:
                standard[j] = values[3, masks[0, :, j], j]
    return rows, standard


def _score_run(
    law: JointErrorModel, run: JointRun, steps: int, blocks: int, lag_known: bool
) -> tuple[ndarray, ndarray, ndarray]:
    """Return error, variance, log score and standardised error (4, N − steps, n) of the predictions
    of ``run``, the masks of SAMPLES (3, N − steps, n) and the block (1, N − steps) of each.
    """
    error = run.measured - run.command
    outlook = law.outlook(error, law.inputs(run.command), steps, lag_known)
    error = error[steps:]
    score, off = outlook.log_probability(error, run.quantum), error - outlook.mean
    variance = outlook.variance + run.quantum**2 / 12  # of the rounded angles
    values = np.stack([off, variance, score, off / np.sqrt(variance)])
    moving, calm = run.moving[steps:], run.calm[steps:] & run.calm[:-steps]
    block = np.arange(len(off)) * blocks // len(off) + 1
    return values, np.stack([moving, moving & calm, ~moving]), block[None]


def _block_rows(values: ndarray, block: ndarray, place: Row) -> list[Row]:
    """Return a row for each block that has samples; ``values`` (4, N) as of :func:`_score_run`."""
    rows = []
    for number in np.unique(block):
        off, variance, score, z = values[:, block == number]
        size = float(np.mean(z**2)) or 1.0
        numbers = {
            "block": int(number),
            "count": len(off),
            "score": score.mean(),
            "predicted_rad": np.sqrt(variance.mean()),
            "measured_rad": np.sqrt(np.mean(off**2)),
            "one_sigma": np.mean(np.abs(z) <= 1),
            "two_sigma": np.mean(np.abs(z) <= 2),
            "autocorrelation": np.nan,
        }
        if len(z) > 1:
            numbers["autocorrelation"] = float(np.mean(z[1:] * z[:-1])) / size
        rows.append(place | numbers)
    return rows


def law_numbers(law: JointErrorModel) -> pd.DataFrame:
    """Return the NUMBERS of ``law``, a row for each joint: standard deviation of an innovation at
    rest and at the greatest speed in rad, time in s in which the slowest mode falls to 1/e (NaN if
    it persists), share of the drift, and degrees of freedom (NaN if they are infinite).
    """
    step = np.diag(law.reach / law.rate)
    fastest = np.einsum("jjj->j", law.covariance_of_joint_step(step))
    still = np.einsum("jjj->j", law.covariance_of_joint_step(0 * step))
    modes = np.abs(np.linalg.eigvals(law.companion())).max(axis=-1)
    decay = np.full(len(modes), np.nan)
    fading = (modes > 0) & (modes < 1 - 1e-9)
    decay[fading] = -1 / (law.rate * np.log(modes[fading]))
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
    least, greatest = by_joint.min(), by_joint.max()
    return least.add_prefix("least:").join(greatest.add_prefix("greatest:"))


def joint_tables(
    runs: Sequence[JointRun],
    laws: Mapping[str, Options],
    unused: Mapping[str, str],
    each=map,
) -> dict[str, pd.DataFrame]:
    """Return the tables of :func:`held_out`, of ``held_out_run`` the rows of the law of the card
    (:func:`chosen_law`, else the last law), and ``joint_parameters`` of the laws fitted to all
    ``runs``, ``motions``, ``motion_ranges`` and ``unused_recordings`` (name → reason, ``unused``).
    """
    tables = held_out(runs, laws, each)
    refits, predictions = tables.pop("held_out_parameters"), tables.pop("held_out_run")
    shown = chosen_law(tables["joint_scores"])[0] or [*laws][-1]
    parameters, motions = [], []
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
        parameters.append(numbers.join(ranges, on="joint"))
    for name in dict.fromkeys(run.motion for run in runs):
        own = [run for run in runs if run.motion == name]
        moved = np.any([run.moving.any(axis=0) for run in own], axis=0)
        moving = ", ".join(np.array(own[0].joints)[moved]) or "none"
        motions.append(
            (name, len(own), max(len(run.command) - 1 for run in own), moving)
        )
    return {
        **tables,
        "held_out_run": predictions[predictions["model"] == shown],
        "joint_parameters": pd.concat(parameters, ignore_index=True),
        "motions": pd.DataFrame(
            motions, columns=["motion", "takes", "steps", "moving"]
        ),
        "motion_ranges": ranges_of_runs(runs),
        "unused_recordings": pd.DataFrame(
            [*unused.items()], columns=["recording", "reason"]
        ),
    }


def ranges_of_runs(runs: Sequence[JointRun]) -> pd.DataFrame:
    """Ranges of the measured poses and of the commanded joint speeds over all ``runs``."""
    poses = np.concatenate([run.measured for run in runs])
    speeds = np.concatenate([lasting_speeds(run) for run in runs])
    errors = np.concatenate([run.measured - run.command for run in runs])
    tables = [
        pd.DataFrame(
            {"quantity": quantity, "name": runs[0].joints, "unit": unit}
        ).assign(least=values.min(axis=0), greatest=values.max(axis=0))
        for quantity, unit, values in (
            ("pose", "rad", poses),
            ("joint speed", "rad/s", speeds),
            ("error", "rad", errors),
        )
    ]
    return pd.concat(tables, ignore_index=True)
