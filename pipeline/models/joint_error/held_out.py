"""Scores of joint error laws on held-out motions: every law is fitted to all motions but one and
scored on that one, at three horizons. Of a single motion, quarters of the runs are held out.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise, product, starmap

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.special import ndtri

from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_error.fit import Options, fit_joint_error
from pipeline.models.joint_error.law import JointErrorModel, drive
from pipeline.models.joint_error.samples import HORIZONS, JointRun, counted, horizons
from pipeline.models.joint_error.search import LEAST
from pipeline.statistics.horizons import QUARTER

QUARTERS = 4  # parts of the runs of a single motion
ENOUGH, BLOCKS = (
    6,
    4,
)  # held-out parts that show their variation; else blocks of each, by time
QUANTILES = np.concatenate(
    [[0.001, 0.005], np.linspace(0.01, 0.99, 49), [0.995, 0.999]]
)
MOVING, RESTING = "commanded", "at rest"
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


def held_out(
    runs: Sequence[JointRun], laws: Mapping[str, Options], each: MapTrials = map
) -> dict[str, pd.DataFrame]:
    """Score the ``laws`` on the held-out parts of ``runs``; ``each`` maps a function over trials.

    Returns ``joint_scores`` (a row for each model, held-out motion, joint, horizon, and commanded
    or resting samples) and ``noise_quantiles`` (standardised errors of one commanded sample). Steps
    within the settling time after a jump of the commanded speed are in neither.
    """
    parts = parts_of(runs)
    trials = list(product(laws, parts))
    results = each(partial(_score_part, laws=laws, parts=parts), trials)
    rows, quantiles, standard = [], [], {}
    for (model, part), (own, z) in zip(trials, results, strict=True):
        rows += [{"model": model, "motion": part} | row for row in own]
        standard.setdefault(model, []).append(z)
    for model, own in standard.items():
        for joint, *errors in zip(runs[0].joints, *own, strict=True):
            z = np.concatenate(errors)
            drawn = (
                np.quantile(z, QUANTILES) if len(z) else np.full(len(QUANTILES), np.nan)
            )
            columns = {
                "model": model,
                "joint": joint,
                "normal": ndtri(QUANTILES),
                "noise": drawn,
            }
            quantiles.append(pd.DataFrame(columns))
    noise = pd.concat(quantiles, ignore_index=True)
    return {"joint_scores": pd.DataFrame(rows), "noise_quantiles": noise}


def _score_part(
    trial: tuple[str, str], *, laws, parts
) -> tuple[list[Row], list[ndarray]]:
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
    rows, standard = [], [np.empty(0)] * len(law.joints)
    names = ["one sample", *(f"{each:g} s" for each in HORIZONS[1:])]
    for steps, horizon in zip(horizons(law.rate), names, strict=True):
        parts = []
        for run in (run for run in runs if len(run.command) > steps + 1):
            error, inputs = (
                run.measured - run.command,
                drive(run.command, run.rate, law.power),
            )
            outlook, error = law.outlook(error, inputs, steps), error[steps:]
            score, off = (
                outlook.log_probability(error, run.quantum),
                error - outlook.mean,
            )
            variance = outlook.variance + run.quantum**2 / 12  # of the rounded angles
            values = np.stack([off, variance, score, z := off / np.sqrt(variance)])
            masks = np.stack([counted(run, steps), ~run.moving[steps:]])
            block = np.arange(len(z)) * blocks // len(z) + 1
            parts.append((values, masks, block[None, :, None]))
        if not parts:
            continue
        values, masks, block = (
            np.concatenate(each, axis=1) for each in zip(*parts, strict=True)
        )
        for (j, joint), (mask, samples) in product(
            enumerate(law.joints), zip(masks, (MOVING, RESTING), strict=True)
        ):
            for number in range(1, blocks + 1):
                together = values[:, mask[:, j] & (block[0, :, 0] == number), j]
                if together.shape[1]:
                    row = {
                        "block": number,
                        "joint": joint,
                        "horizon": horizon,
                        "samples": samples,
                    }
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
        "autocorrelation": float(np.mean(z[1:] * z[:-1])) / size
        if len(z) > 1
        else np.nan,
    }


def joint_tables(
    runs: Sequence[JointRun],
    laws: Mapping[str, Options],
    unused: Mapping[str, str],
    each=map,
) -> dict[str, pd.DataFrame]:
    """Return the tables of :func:`held_out`, and ``joint_parameters`` of the laws fitted to all
    ``runs``, ``motions``, ``motion_ranges`` and ``unused_recordings`` (name → reason, ``unused``).
    """
    parameters, motions = [], []
    for name, options in laws.items():
        law = fit_joint_error(runs, **options.law())
        step = np.diag(law.reach / law.rate)
        fastest, still = (
            law.covariance_of_joint_step(each) for each in (step, 0 * step)
        )
        modes = np.abs(np.linalg.eigvals(law.companion())).max(axis=-1)
        decay = -1 / (law.rate * np.log(np.minimum(modes, 1 - 1e-9)))
        columns = {
            "innovation_at_rest_rad": np.sqrt(np.einsum("jjj->j", still)),
            "innovation_at_greatest_speed_rad": np.sqrt(np.einsum("jjj->j", fastest)),
            "decay_s": np.where(modes >= 1 - 1e-9, np.nan, decay),
            "drift_share": law.drift,
            "degrees": np.where(np.isfinite(law.degrees), law.degrees, np.nan),
            "greatest_speed": law.reach,
            "has_mean": np.any(law.mean_gain != 0, axis=1),
        }
        parameters.append(pd.DataFrame({"model": name, "joint": law.joints} | columns))
    for name in dict.fromkeys(run.motion for run in runs):
        own = [run for run in runs if run.motion == name]
        moved = np.any([run.moving.any(axis=0) for run in own], axis=0)
        moving = ", ".join(np.array(own[0].joints)[moved]) or "none"
        motions.append(
            (name, len(own), max(len(run.command) - 1 for run in own), moving)
        )
    return {
        **held_out(runs, laws, each),
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
    speeds = runs[0].rate * np.concatenate(
        [np.diff(run.command, axis=0) for run in runs]
    )
    tables = [
        pd.DataFrame(
            {"quantity": quantity, "name": runs[0].joints, "unit": unit}
        ).assign(least=values.min(axis=0), greatest=values.max(axis=0))
        for quantity, unit, values in (
            ("pose", "rad", poses),
            ("joint speed", "rad/s", speeds),
        )
    ]
    return pd.concat(tables, ignore_index=True)
