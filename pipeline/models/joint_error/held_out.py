"""Scores of joint error laws on held-out motions: every law is fitted to all motions but one and
scored on that one, at three horizons. Of a single motion, quarters of the runs are held out.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.special import ndtri

from pipeline.models.joint_error.fit import Options, fit_joint_error
from pipeline.models.joint_error.law import JointErrorModel, drive
from pipeline.models.joint_error.samples import HORIZONS, JointRun, commanded, counted, horizons

QUARTERS = 4  # parts of the runs of a single motion
ENOUGH, BLOCKS = 6, 4  # held-out parts that show their variation; else blocks of each, by time
QUANTILES = np.concatenate([[0.001, 0.005], np.linspace(0.01, 0.99, 49), [0.995, 0.999]])
MOVING, RESTING = "commanded", "at rest"
Row = dict[str, object]


def names_of_horizons() -> list[str]:
    """Names of HORIZONS in tables."""
    return ["one sample", *(f"{each:g} s" for each in HORIZONS[1:])]


def parts_of(runs: Sequence[JointRun]) -> dict[str, tuple[list[JointRun], list[JointRun]]]:
    """Part that is held out → the other runs, its runs. A part is a motion; of a single motion, a
    quarter of every run.
    """
    if len({run.motion for run in runs}) == 1:
        runs = [
            replace(run, command=run.command[cut], measured=run.measured[cut], motion=name)
            for run in runs
            for name, cut in _quarters(len(run.command))
        ]
    names = dict.fromkeys(run.motion for run in runs)
    return {
        name: ([r for r in runs if r.motion != name], [r for r in runs if r.motion == name])
        for name in names
    }


def _quarters(length: int) -> list[tuple[str, slice]]:
    ends = np.linspace(0, length, QUARTERS + 1).astype(int)
    return [(f"quarter {i + 1}", slice(ends[i], ends[i + 1])) for i in range(QUARTERS)]


def held_out(
    runs: Sequence[JointRun],
    laws: Mapping[str, Options],
    each: Callable[[Callable, Sequence], Iterable] = map,
) -> dict[str, pd.DataFrame]:
    """Score the ``laws`` on the held-out parts of ``runs``; ``each`` maps a function over trials.

    Returns ``joint_scores`` (a row for each model, held-out motion, joint, horizon, and commanded
    or resting samples) and ``noise_quantiles`` (standardised errors of one commanded sample). Steps
    within the settling time after a jump of the commanded speed are in neither.
    """
    parts = parts_of(runs)
    trials = list(product(laws, parts))
    results = each(partial(_score_part, laws=laws, parts=parts), trials)
    rows, standard = [], {}
    for (model, part), (own, z) in zip(trials, results, strict=True):
        rows += [{"model": model, "motion": part} | row for row in own]
        standard.setdefault(model, []).append(z)
    return {"joint_scores": pd.DataFrame(rows), "noise_quantiles": _quantiles(standard, runs)}


def _score_part(trial: tuple[str, str], *, laws, parts) -> tuple[list[Row], list[ndarray]]:
    model, part = trial
    others, own = parts[part]
    law = fit_joint_error(others, **laws[model].law())
    return score_runs(law, own, blocks=1 if len(parts) >= ENOUGH else BLOCKS)


def score_runs(
    law: JointErrorModel, runs: Sequence[JointRun], blocks: int = 1
) -> tuple[list[Row], list[ndarray]]:
    """Score the predictions of ``law`` on ``runs``: rows by joint, horizon, commanded or resting
    samples and block of the runs' time, and the standardised errors of one commanded sample by
    joint.
    """
    rows, standard = [], [np.empty(0) for _ in law.joints]
    for steps, horizon in zip(horizons(law.rate), names_of_horizons(), strict=True):
        parts = []
        for run in runs:
            if len(run.command) <= steps + 1:
                continue
            error = run.measured - run.command
            outlook = law.outlook(error, drive(run.command, run.rate, law.power), steps)
            score = outlook.log_probability(error[steps:], run.quantum)
            moving = counted(run, steps)
            resting = ~commanded(run.command, run.rate)[steps:]
            z = outlook.std_share(error[steps:])
            block = np.arange(len(z)) * blocks // len(z) + 1
            values = np.stack([error[steps:] - outlook.mean, outlook.variance, score, z])
            parts.append((values, {MOVING: moving, RESTING: resting}, block))
        for (j, joint), samples in product(enumerate(law.joints), (MOVING, RESTING)):
            for number in range(1, blocks + 1):
                chosen = [
                    values[:, masks[samples][:, j] & (block == number), j]
                    for values, masks, block in parts
                ]
                together = np.concatenate(chosen, axis=1) if chosen else np.empty((4, 0))
                if together.shape[1]:
                    row = {"block": number, "joint": joint, "horizon": horizon, "samples": samples}
                    rows.append(row | _summary(*together))
                if samples == MOVING and steps == 1:
                    standard[j] = np.concatenate([standard[j], together[3]])
    return rows, standard


def _summary(off: ndarray, variance: ndarray, score: ndarray, z: ndarray) -> Row:
    size = float(np.mean(z**2)) or 1.0
    return {
        "count": len(off),
        "score": score.mean(),
        "predicted_rad": np.sqrt(variance.mean()),
        "measured_rad": np.sqrt(np.mean(off**2)),
        "one_sigma": np.mean(np.abs(z) <= 1),
        "two_sigma": np.mean(np.abs(z) <= 2),
        "autocorrelation": float(np.mean(z[1:] * z[:-1])) / size if len(z) > 1 else np.nan,
    }


def _quantiles(standard: Mapping[str, Sequence], runs: Sequence[JointRun]) -> pd.DataFrame:
    rows = []
    for model, parts in standard.items():
        for j, joint in enumerate(runs[0].joints):
            z = np.concatenate([part[j] for part in parts])
            drawn = np.quantile(z, QUANTILES) if len(z) else np.full(len(QUANTILES), np.nan)
            columns = {"model": model, "joint": joint, "normal": ndtri(QUANTILES), "noise": drawn}
            rows.append(pd.DataFrame(columns))
    return pd.concat(rows, ignore_index=True)


def joint_tables(
    runs: Sequence[JointRun],
    laws: Mapping[str, Options],
    unused: Mapping[str, str],
    each: Callable[[Callable, Sequence], Iterable] = map,
) -> dict[str, pd.DataFrame]:
    """Return the tables of :func:`held_out`, and ``joint_parameters`` of the laws fitted to all
    ``runs``, ``motions``, ``motion_ranges`` and ``unused_recordings`` (name → reason, ``unused``).
    """
    fitted = {name: fit_joint_error(runs, **options.law()) for name, options in laws.items()}
    return {
        **held_out(runs, laws, each),
        "joint_parameters": pd.concat(
            [_parameters(name, law) for name, law in fitted.items()], ignore_index=True
        ),
        "motions": _motions(runs),
        "motion_ranges": ranges_of_runs(runs),
        "unused_recordings": pd.DataFrame([*unused.items()], columns=["recording", "reason"]),
    }


def _parameters(name: str, law: JointErrorModel) -> pd.DataFrame:
    step = np.diag(law.reach / law.rate)
    fastest = np.diagonal(law.covariance_of_joint_step(step), axis1=-2, axis2=-1)
    still = np.diagonal(law.covariance_of_joint_step(0 * step), axis1=-2, axis2=-1)
    modes = np.abs(np.linalg.eigvals(law.companion())).max(axis=-1)
    persists, fading = modes >= 1 - 1e-9, np.minimum(modes, 1 - 1e-9)
    columns = {
        "innovation_at_rest_rad": np.sqrt(np.diag(still)),
        "innovation_at_greatest_speed_rad": np.sqrt(np.diag(fastest)),
        "decay_s": np.where(persists, np.nan, -1 / (law.rate * np.log(fading))),
        "drift_share": law.drift,
        "degrees": np.where(np.isfinite(law.degrees), law.degrees, np.nan),
        "greatest_speed": law.reach,
        "has_mean": np.any(law.mean_gain != 0, axis=1),
    }
    return pd.DataFrame({"model": name, "joint": law.joints} | columns)


def _motions(runs: Sequence[JointRun]) -> pd.DataFrame:
    rows = []
    for name in dict.fromkeys(run.motion for run in runs):
        own = [run for run in runs if run.motion == name]
        moved = np.any([commanded(run.command, run.rate).any(axis=0) for run in own], axis=0)
        moving = ", ".join(np.array(own[0].joints)[moved]) or "none"
        longest = max(len(run.command) - 1 for run in own)
        rows.append((name, len(own), longest, moving))
    return pd.DataFrame(rows, columns=["motion", "takes", "steps", "moving"])


def ranges_of_runs(runs: Sequence[JointRun]) -> pd.DataFrame:
    """Ranges of the measured poses and of the commanded joint speeds over all ``runs``."""
    rate, joints = runs[0].rate, runs[0].joints
    poses = np.concatenate([run.measured for run in runs])
    speeds = rate * np.concatenate([np.diff(run.command, axis=0) for run in runs])
    return pd.concat(
        [
            pd.DataFrame({"quantity": quantity, "name": joints, "unit": unit}).assign(
                least=values.min(axis=0), greatest=values.max(axis=0)
            )
            for quantity, unit, values in (("pose", "rad", poses), ("joint speed", "rad/s", speeds))
        ],
        ignore_index=True,
    )
