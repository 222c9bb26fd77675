"""Differences between models in quantities that only all takes together have, with intervals by
resampling the takes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import permutations

import numpy as np
import pandas as pd

from pipeline.statistics.joint_scores import bound_scores
from pipeline.statistics.takes import percentile_interval, student_quantile

REPLICATES = 200
NO_NOISE = "no_noise"  # in the place of a model

# model, numbers of the takes → value by quantity
Quantities = Callable[[str, np.ndarray], dict[str, float]]


def drawn_takes(takes: int, rng: np.random.Generator) -> list[np.ndarray]:
    """The numbers of the ``takes`` that each of REPLICATES resamplings draws: none of a single
    take, and of few takes not those that hold one alone.
    """
    drawn = [rng.integers(takes, size=takes) for _ in range(REPLICATES if takes > 1 else 0)]
    # one take over and over has no spread that a quantity could be of
    return [numbers for numbers in drawn if np.ptp(numbers) > 0]


def resampled_differences(
    quantities: Quantities, models: Sequence[str], takes: int, rng: np.random.Generator
) -> pd.DataFrame:
    """Every quantity of every model, and its difference to the first model with the 95 % percentile
    interval of the bootstrap over takes.

    The same takes are drawn for all models, so that the difference is a paired one; of few takes
    those resamplings are left out that hold one alone. A model without a quantity has no row of it;
    there is no interval for a single take.
    """
    everything = [quantities(model, np.arange(takes)) for model in models]
    drawn = drawn_takes(takes, rng)
    resampled = [[quantities(model, numbers) for numbers in drawn] for model in models]
    rows = []
    for model, values, replicates in zip(models, everything, resampled, strict=True):
        for name, value in values.items():
            row = {"model": model, "quantity": name, "value": value}
            if model != models[0] and name in everything[0]:
                row["difference"] = value - everything[0][name]
                differences = [
                    own[name] - first[name]
                    for own, first in zip(replicates, resampled[0], strict=True)
                ]
                if differences:
                    row["low"], row["high"] = percentile_interval(differences)
            rows.append(row)
    return pd.DataFrame(rows, columns=["model", "quantity", "value", "difference", "low", "high"])


def bound_quantities(
    error: Mapping[str, np.ndarray], bound: Mapping[str, np.ndarray], joints: Sequence[str]
) -> Quantities:
    """How each filter's bound follows its error, of ``error`` and ``bound`` (takes, K, n) in rad by
    model and the names of the n ``joints``: see ``bound_scores``.
    """

    def quantities(model: str, takes: np.ndarray) -> dict[str, float]:
        return {
            f"{name}_{joint}": value
            for j, joint in enumerate(joints)
            for name, value in bound_scores(
                error[model][takes, :, j], bound[model][takes, :, j]
            ).items()
        }

    return quantities


def spread_comparison(
    motion: Mapping[str, np.ndarray],
    measurement: np.ndarray,
    noise: np.ndarray,
    joints: Sequence[str],
) -> pd.DataFrame:
    """Relative error of each model's standard deviation over time in each joint, and its difference
    to three others, with 95 % intervals of the jackknife over takes: to the first model in the same
    joint, to no noise at all (NO_NOISE, whose error is 1), and to the same model in the last joint.

    All models have one level: in every set of takes each model's variances have the factor by which
    their sum over joints and steps, with the measurement noise, is that of the takes. For the
    Wishart model the factor is an approximation, as the share of its joints depends slightly on
    σ_B.

    Args:
        motion: by model (M, n) rad², variances of a step without measurement noise.
        measurement: (n,) rad², variances of the measurement noise.
        noise: (takes, M, n) rad, recorded noise with measurement noise.
        joints: names of the n joints.
    """
    counts = _counts(len(noise))
    recorded = _variances(counts, noise)
    total = recorded.mean(axis=1).sum(axis=-1) - measurement.sum()
    errors = {}
    for model, own in motion.items():
        factor = np.maximum(total, 0) / own.mean(axis=0).sum()
        modelled = np.sqrt(factor[:, None, None] * own + measurement)
        distance = np.linalg.norm(modelled - np.sqrt(recorded), axis=1)
        errors[model] = distance / np.sqrt(recorded.sum(axis=1))  # (1 + resamplings, n)
    first, last, rows = next(iter(motion)), len(joints) - 1, []
    for model, error in errors.items():
        for j, joint in enumerate(joints):
            others = {(NO_NOISE, joint): np.ones(len(error))}
            if model != first:
                others[first, joint] = errors[first][:, j]
            if j != last:
                others[model, joints[last]] = error[:, last]
            for (rival, where), other in others.items():
                row = {"model": model, "joint": joint, "rival": rival, "rival_joint": where}
                row |= {"error": error[0, j], "rival_error": other[0]}
                rows.append(row | _difference(error[:, j] - other))
    names = ["model", "joint", "rival", "rival_joint", "error", "rival_error"]
    return pd.DataFrame(rows, columns=[*names, "difference", "low", "high"])


def mean_error_comparison(error: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Standard deviation over time of the error of each model's mean, ‖mean − recorded mean‖ in
    rad, and its difference to every other model's with the 95 % interval of the jackknife over
    takes.

    ``error`` (takes, M, n) in rad by model: exact mean of a step minus the measured pose.
    """
    takes = len(next(iter(error.values())))
    counts = _counts(takes)
    weights = counts / counts.sum(axis=1, keepdims=True)
    varies = {}
    for model, own in error.items():
        means = (weights @ own.reshape(takes, -1)).reshape(-1, *own.shape[1:])
        varies[model] = np.linalg.norm(means, axis=-1).std(axis=1)
    rows = [
        {"model": model, "rival": rival, "std_over_time_rad": varies[model][0]}
        | {"rival_std_over_time_rad": varies[rival][0]}
        | _difference(varies[model] - varies[rival])
        for model, rival in permutations(varies, 2)
    ]
    names = ["model", "rival", "std_over_time_rad", "rival_std_over_time_rad"]
    return pd.DataFrame(rows, columns=[*names, "difference", "low", "high"])


def share_between(noise: np.ndarray, groups: Sequence[str]) -> float:
    """Share of the variance of ``noise`` (takes, M, n) over the takes, summed over steps and
    joints, that lies between the means of their ``groups`` (takes,), the recordings they come from.

    About (groups − 1)/(takes − 1) where takes of one recording are no more alike than others; 0 for
    one group, or where every take is a group of its own.
    """
    names = list(dict.fromkeys(groups))
    if len(names) in (1, len(groups)):
        return 0.0
    member = np.array([[group == name for group in groups] for name in names], dtype=float)
    centred = (noise - noise.mean(axis=0)).reshape(len(noise), -1)
    means = member @ centred / member.sum(axis=1, keepdims=True)
    between = member.sum(axis=1) @ np.sum(means**2, axis=1)
    return float(between / np.sum(centred**2))


def _counts(takes: int) -> np.ndarray:
    """(1 + takes, takes) weights: of all takes in the first row, then of all but one."""
    return np.vstack([np.ones((1, takes)), 1 - np.eye(takes)])


def _variances(counts: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(R, M, n) sample variances over the takes of ``noise`` (takes, M, n), as often as ``counts``
    (R, takes) names them.
    """
    flat, takes = (noise - noise.mean(axis=0)).reshape(len(noise), -1), counts.sum(axis=1)[:, None]
    mean = counts @ flat / takes
    squares = np.maximum(counts @ flat**2 / takes - mean**2, 0)
    with np.errstate(divide="ignore", invalid="ignore"):  # one take has no variance
        return (squares * takes / (takes - 1)).reshape(-1, *noise.shape[1:])


def _difference(values: np.ndarray) -> dict[str, float]:
    """The first of ``values`` (1 + takes,), of all takes, with the 95 % interval of the jackknife:
    Student's, from the others, each of all takes but one. No interval below three takes.
    """
    row = {"difference": float(values[0]), "low": np.nan, "high": np.nan}
    takes = len(values) - 1
    if takes > 2:
        error = np.sqrt((takes - 1) * np.var(values[1:]))
        half = student_quantile(takes - 1) * error
        row["low"], row["high"] = values[0] - half, values[0] + half
    return row
