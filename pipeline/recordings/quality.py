"""Account of each take: what it resembles and by how much, how late and how disturbed it is, what
was lost and repaired; the limits of these measures, and the takes that they leave.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.distance import squareform

from pipeline.core.errors import RecordingError
from pipeline.recordings.lags import REACH, lag

DEPTH_CAMERA = "depth camera"  # name of the instrument in the tables
# counts of a movement: repetitions (takes), and prefix of the counts of left-out motions by reason
REPETITIONS = "repetitions"
LEFT_OUT = "excursions_"
# quantities of the table ``quality`` that do not depend on the length of a take
MEASURES = (
    "missing_share longest_gap interpolated relabelled_share residual_rms dropped_share "
    "clock_offset clock_offset_standard_error clock_drift clock_drift_standard_error "
    "camera_residual_share lag_behind_command lag_beside_others greatest_residual "
    "residual_beside_others disturbance nearest_take alike_takes likeness"
).split()
# measures whose limit applies to the absolute value
TWO_SIDED = ("clock_drift", "lag_behind_command", "lag_beside_others")
FEWEST = 2  # least number of takes of a part, for the covariance and for leaving one take out

SAME_SAMPLES = 2e-6  # m, rad or N: rounding to six decimals, below any noise
DECIMALS = 9  # values that differ by less are one value, converted twice
# likeness: rows over which noise averages out, and least number of such blocks in a take
BLOCK = 10
LEAST_BLOCKS = 20
# order of differences, and their variance of white noise of 1
DIFFERENCES = 6
NOISE_GAIN = 924
WITHIN = 1.5  # noise, greatest distance of equal takes: 1 for white noise, 1.3 with heavy tails
# a group of more than half of the takes is equal by copying only if so many takes are not in it:
# else the arm repeats within the noise, and the few takes outside are disturbed
LEAST_OUTSIDE = 3
SHARE_OUTSIDE = 0.25
# disturbance: least scale of the score of a whole take (the second term over the number of takes:
# few takes do not show their scale) and of its greatest window, over the median of the takes;
# LEAST_OF_JOINT is the least scale of a joint, over the median of all joints
LEAST_SPREAD = 0.15
OF_FEW_TAKES = 0.3
LEAST_IN_WINDOWS = 0.6
LEAST_OF_JOINT = 0.25
WINDOW = 0.25  # s, duration of a push by hand
OVERLAP = 4  # number of windows that begin within the time of one window
# 0.8 quantile of a residual over its noise, below which images of two takes are alike
NOISE_MARGIN = 2.5


def quality_row(
    take: str,
    part_name: str,
    instrument: str,
    quantity: str,
    value: float,
    unit: str = "count",
) -> dict[str, object]:
    """Return one row of the table ``quality``."""
    row = {"take": take, "part": part_name, "instrument": instrument}
    return row | {"quantity": quantity, "value": float(value), "unit": unit}


def quality_rows(
    take: str,
    part_name: str,
    instrument: str,
    notes: Iterable[tuple],
) -> list[dict[str, object]]:
    """Return a row of the table ``quality`` for each note: quantity, value, unit unless a count."""
    return [quality_row(take, part_name, instrument, *note) for note in notes]


def summarise(quality: pd.DataFrame) -> pd.DataFrame:
    """Return, by instrument and quantity, total (of counts), mean (of others) and extremes."""
    measured = quality[quality["unit"] != "row"]
    values = measured.groupby(["instrument", "quantity", "unit"])["value"]
    table = values.agg(total="sum", mean="mean", least="min", greatest="max")
    table = table.reset_index()
    counted = table["unit"] == "count"
    table["total"] = table["total"].where(counted)
    table["mean"] = table["mean"].where(~counted)
    return table


def are_equal(
    first: np.ndarray,
    second: np.ndarray,
    tolerance: np.ndarray | float = SAME_SAMPLES,
) -> bool:
    """Return whether two arrays are equal to within ``tolerance``, with NaN in the same places."""
    if first.shape != second.shape:
        return False
    close = partial(np.allclose, rtol=0.0, atol=tolerance, equal_nan=True)
    # the first row suffices for most
    return close(first[:1], second[:1]) and close(first, second)


def rounding(samples: np.ndarray) -> np.ndarray:
    """Return half of the least step (n,) between the values of each column of ``samples`` (N, n):
    another export of the same recording is equal to it within this, another recording is not.
    """
    halves = []
    for column in samples.T:
        values = np.unique(np.round(column, DECIMALS))
        halves.append(np.diff(values).min(initial=np.inf) / 2)
    least = np.array(halves)
    return np.where(np.isinf(least), 0.0, least) + SAME_SAMPLES


def require_distinct(
    what: str,
    samples: Mapping[str, np.ndarray],
    parts: Mapping[str, str] = {},
    tolerances: Mapping[str, np.ndarray] = {},
) -> None:
    """Raise RecordingError where two ``samples`` are equal to within rounding, or to within the
    greater of their ``tolerances``; ``parts`` of the names are printed with them.
    """
    for first, second in combinations(samples, 2):
        tolerance = np.maximum(
            tolerances.get(first, SAME_SAMPLES),
            tolerances.get(second, SAME_SAMPLES),
        )
        if are_equal(samples[first], samples[second], tolerance):
            names = sorted((first, second))
            named = [f"{parts.get(name, '')} {name}".strip() for name in names]
            raise RecordingError(
                f"the {what} {' and '.join(named)} have equal samples: one is a copy of the "
                "other; take it out, or record it again",
                take=second,
            )


def compare_takes(
    angles: np.ndarray,
    residuals: np.ndarray,
    rate: float,
    limit: float | None,
) -> dict[str, tuple[np.ndarray, str]]:
    """Return quantity → values (takes,) and unit of what each take is beside the others:
    :func:`likeness`, :func:`disturbances` and :func:`lags_beside_others`.

    ``angles`` (takes, K, n) in rad are measured, with NaN where they are not; ``residuals`` are
    these minus the command, or minus what all takes share; ``rate`` in Hz. Of a group of copies,
    beyond the ``limit`` of the likeness, one take counts in the median that others deviate from.
    """
    alike = likeness(angles)
    distinct = _distinct_takes(alike, limit)
    usual = np.nanmedian(residuals, axis=0)
    residuals = np.where(np.isnan(residuals), usual, residuals)
    scores = disturbances(residuals, rate, distinct)
    distances = beside_others(residuals, distinct)
    lags = lags_beside_others(angles, rate)
    return {
        "likeness": (alike.ratio, "1"),
        "alike_takes": (alike.size, "takes"),
        "nearest_take": (alike.nearest, "noise"),
        "disturbance": (scores, "robust standard deviations"),
        "residual_beside_others": (distances, "rad"),
        "lag_beside_others": (lags, "s"),
    }


class Likeness(NamedTuple):
    """Groups of takes that are equal within the noise; arrays (takes,)."""

    ratio: np.ndarray  # distance of the group to the next take, in noise; 1 without
    size: np.ndarray  # number of takes in the group; 1 without
    group: np.ndarray  # first take of the group, the take itself without
    nearest: np.ndarray  # distance to the nearest take, in noise; NaN for a single take


def _distinct_takes(alike: Likeness, limit: float | None) -> np.ndarray:
    """Return the mask (takes,) of takes that are not copies of an earlier take: their likeness is
    within the ``limit``, or they are the first of their group.
    """
    if limit is None:
        return np.ones(len(alike.group), bool)
    _, firsts = np.unique(alike.group, return_index=True)
    distinct = alike.ratio <= limit
    distinct[firsts] = True
    return distinct


def likeness(angles: np.ndarray) -> Likeness:
    """Return the groups of takes in ``angles`` (takes, K, n) rad that are equal within the noise,
    whatever their number: :func:`noise_distances` of all moving joints up to WITHIN. The ratio is
    at most 1.2 for recorded takes, and above 4 for copies with noise, offset, drift, scale of a few
    percent or lag. If one joint is equal, the ratio is the root of the joint's ratio.

    Takes that are all equal within the noise have the ratio 1: the arm may repeat within its noise.
    """
    number = len(angles)
    by_joint = noise_distances(angles)
    ratio = np.ones(number)
    size = np.ones(number)
    group = np.arange(number)
    nearest = np.full(number, np.nan)
    if number < 2 or not len(by_joint):
        return Likeness(ratio, size, group, nearest)
    of_all = by_joint.max(axis=0)
    nearest = np.sort(of_all, axis=1)[:, 1]
    groups = []
    for members, distance in _equal_takes(of_all):
        outside = number - len(members)
        few_outside = outside < LEAST_OUTSIDE or outside <= SHARE_OUTSIDE * number
        if len(members) <= number / 2 or not few_outside:
            groups.append((members, distance))

    for joint in by_joint:
        for members, distance in _equal_takes(joint):
            if len(members) <= number / 2:
                groups.append((members, np.sqrt(distance)))
    for members, distance in groups:
        nearer = members[distance > ratio[members]]
        ratio[nearer] = distance
        size[nearer] = len(members)
        group[nearer] = members.min()
    return Likeness(ratio, size, group, nearest)


def noise_distances(angles: np.ndarray) -> np.ndarray:
    """Return the distances (n, takes, takes) between ``angles`` (takes, K, m) rad of the n joints
    that move, in units of the noise: 1 if two takes differ by white noise only.

    A distance is the root mean square of the means over BLOCK rows, in which noise averages out
    and a deviation of the arm does not. An offset, drift, scale, lag and its square are fitted. The
    variance of the noise is the variance of DIFFERENCES-th differences over their gain, by median.
    """
    usual = np.nan_to_num(np.nanmedian(angles, axis=0))
    moves = np.ptp(usual, axis=0) > REACH
    angles = np.where(np.isnan(angles), usual, angles)[:, :, moves]
    rows = max(min(BLOCK, angles.shape[1] // LEAST_BLOCKS), 1)
    jumps = np.abs(np.diff(angles, DIFFERENCES, axis=1))
    gain = np.sqrt(NOISE_GAIN * rows)
    noise = 1.4826 * np.median(jumps, axis=1).T / gain  # (n, takes)

    speed = np.gradient(angles, axis=1)
    takes = _block_means(angles, rows)
    acceleration = _block_means(np.gradient(speed, axis=1), rows)
    speed = _block_means(speed, rows)

    constant = np.ones_like(takes[:, 0])
    time = np.cumsum(constant, axis=1)
    distances = np.zeros((len(takes), len(angles), len(angles)))
    for i in range(len(angles)):
        fitted = constant, time, takes[:, i], speed[:, i], acceleration[:, i]
        basis = np.linalg.qr(np.stack(fitted, axis=-1))[0]  # (n, blocks, 5)

        apart = takes - takes[:, [i]]
        apart = apart - apart @ basis @ np.swapaxes(basis, 1, 2)
        freedom = max(apart.shape[-1] - len(fitted), 1)
        squares = np.sum(apart**2, axis=-1) / freedom
        variance = noise**2 + noise[:, [i]] ** 2 + SAME_SAMPLES**2
        distances[:, i] = np.sqrt(squares / variance)
    return np.minimum(distances, np.swapaxes(distances, 1, 2))


def _block_means(signal: np.ndarray, rows: int) -> np.ndarray:
    """Return the means (n, takes, blocks) of ``signal`` (takes, K, n) over blocks of ``rows``."""
    takes, length, joints = signal.shape
    blocks = length // rows
    cut = signal[:, : blocks * rows].reshape(takes, blocks, rows, joints)
    return np.moveaxis(cut.mean(axis=2), 2, 0)


def _equal_takes(distances: np.ndarray) -> Iterator[tuple[np.ndarray, float]]:
    """Yield the members of each cluster of takes within WITHIN of each other by single linkage of
    the ``distances`` (takes, takes) in noise, and its distance to the next take over its own, which
    counts at least as 1.
    """
    from scipy.cluster.hierarchy import linkage

    # a cluster of scipy has the number of takes plus the row of its link
    members = [np.array([take]) for take in range(len(distances))]
    within = [np.inf] * len(distances)  # greatest link in the cluster
    for first, second, distance, _ in linkage(squareform(distances), "single"):
        children = int(first), int(second)
        for child in children:
            if within[child] <= WITHIN:
                yield members[child], distance / max(within[child], 1.0)
        members.append(np.concatenate([members[child] for child in children]))
        within.append(distance)


def lags_beside_others(angles: np.ndarray, rate: float) -> np.ndarray:
    """Return the lags (takes,) in s of ``angles`` (takes, K, n) rad behind their median, at
    ``rate`` in Hz; 0 for two takes.
    """
    if len(angles) < 3:
        return np.zeros(len(angles))
    median = np.nanmedian(angles, axis=0)
    return np.array([lag_of_take(median, take, rate) for take in angles])


def lag_of_take(command: np.ndarray, take: np.ndarray, rate: float) -> float:
    """Return the lag in s of ``take`` (K, n) behind ``command``, over the rows without NaN."""
    measured = np.isfinite(take).all(axis=1) & np.isfinite(command).all(axis=1)
    return lag(command[measured], take[measured], rate)


def disturbances(
    residuals: np.ndarray,
    rate: float,
    distinct: np.ndarray | None = None,
) -> np.ndarray:
    """Return the distance (takes,) of each take from the median take, in robust standard deviations
    (1.4826 times the median absolute deviation, at least LEAST_SPREAD, more for few takes, or
    LEAST_IN_WINDOWS of the median); the medians are of the ``distinct`` takes (default all).

    The distance is the greater of two: the root mean square over the take, and the greatest mean
    over a joint and window. ``residuals`` (takes, K, joints) rad are measured minus commanded
    angles, ``rate`` in Hz. With two takes, the distances are 0.
    """
    if distinct is None:
        distinct = np.ones(len(residuals), bool)
    least = LEAST_SPREAD + OF_FEW_TAKES / distinct.sum()
    whole = _scores(beside_others(residuals, distinct), distinct, least)
    windows = _greatest_in_windows(residuals, rate, distinct)
    return np.maximum(_scores(windows, distinct, LEAST_IN_WINDOWS), whole)


def beside_others(signal: np.ndarray, distinct: np.ndarray) -> np.ndarray:
    """Return the root mean square distance (takes,) of ``signal`` from the median of the
    ``distinct`` takes.
    """
    median = np.median(signal[distinct], axis=0)
    return np.sqrt(np.mean((signal - median) ** 2, axis=(-2, -1)))


def _greatest_in_windows(
    signal: np.ndarray,
    rate: float,
    distinct: np.ndarray,
) -> np.ndarray:
    """Return the greatest relative distance (takes,) from the median in a joint and window."""
    distance = signal - np.median(signal[distinct], axis=0)
    length = signal.shape[1]
    rows = min(max(round(WINDOW * rate), 1), length)
    starts = np.arange(0, length - rows + 1, max(rows // OVERLAP, 1))

    sums = np.cumsum(distance, axis=1)
    sums = np.concatenate([np.zeros_like(sums[:, :1]), sums], axis=1)
    means = np.abs(sums[:, starts + rows] - sums[:, starts]) / rows

    # medians (windows, joints), (joints,) and of all
    compared = means[distinct]
    by_window = np.median(compared, axis=0)
    by_joint = np.median(compared, axis=(0, 1))
    least = np.maximum(by_joint, LEAST_OF_JOINT * np.median(compared))
    usual = np.maximum(by_window, least)
    ratios = np.divide(means, usual, out=np.ones_like(means), where=usual > 0)
    return ratios.max(axis=(1, 2))


def _scores(distance: np.ndarray, distinct: np.ndarray, least: float) -> np.ndarray:
    """Return ``distance`` (takes,) minus the median of the ``distinct`` takes, in robust standard
    deviations of these, at least ``least`` of the median.
    """
    median = np.median(distance[distinct])
    deviations = np.abs(distance[distinct] - median)
    deviation = 1.4826 * np.median(deviations)
    scale = max(deviation, least * median)
    return (distance - median) / scale if scale > 0 else np.zeros_like(distance)


def residual_share(
    seen: np.ndarray,
    residual: float,
    foreign_residuals: list[float],
) -> float:
    """Return the ``residual`` of a take's centroids ``seen`` (F, d) in m beside its joints, over
    the median of the ``foreign_residuals`` beside the joints of other takes.

    The share is 1 for the images of another take. Takes that differ by less than the noise of
    ``seen`` cannot be told apart; their share is below 1.
    """
    # mostly at rest: the motion adds to a few
    jumps = np.abs(np.diff(seen, DIFFERENCES, axis=0))
    noise = 1.4826 * np.median(jumps) / np.sqrt(NOISE_GAIN)
    usual = float(np.median(foreign_residuals))
    return float(residual / max(usual, NOISE_MARGIN * noise))


def beside_limits(
    quality: pd.DataFrame,
    limits: dict[str, float | None],
) -> pd.DataFrame:
    """Return the table ``takes`` from the table ``quality``: measures, their limits (in the unit of
    the measure; None: no limit), and whether a take is left out; training takes first.
    """
    measured = quality[quality["quantity"].isin(MEASURES)]
    takes = measured.rename(columns={"quantity": "measure"})
    takes["limit"] = takes["measure"].map(limits).astype(float)
    two_sided = takes["measure"].isin(TWO_SIDED)
    size = takes["value"].abs().where(two_sided, takes["value"])
    takes["beyond"] = size > takes["limit"]
    takes["left_out"] = takes["beyond"].groupby(takes["take"]).transform("any")
    takes["place"] = takes["measure"].map(MEASURES.index)
    order = ["part", "take", "place"]
    ascending = [False, True, True]
    takes = takes.sort_values(order, ascending=ascending, ignore_index=True)
    return takes.drop(columns=["instrument", "place"])


def reasons_by_take(takes: pd.DataFrame) -> pd.Series:
    """Return take → text of the measures beyond their limits, of each take that is left out."""
    beyond = takes[takes["beyond"]]
    sizes = takes[takes["measure"] == "alike_takes"].set_index("take")["value"]
    words = []
    for row in beyond.itertuples():
        reason = f"{row.measure} {row.value:.3g} beyond {row.limit:g}"
        if row.measure == "likeness":
            reason += f", {sizes[row.take]:g} takes are copies of one"
        words.append(reason)
    by_row = pd.Series(words, beyond["take"], dtype="str")
    return by_row.groupby(level=0, sort=False).agg(", ".join)


def reasons(takes: pd.DataFrame) -> list[str]:
    """Return name and reason of every take that is left out, in the order of ``takes``."""
    return [f"{take} ({words})" for take, words in reasons_by_take(takes).items()]


def side_by_side(takes: pd.DataFrame) -> pd.DataFrame:
    """Return one row per take of the table ``takes``: measures, whether and why it is left out."""
    in_brackets = " (" + takes["unit"] + ")"
    unit = in_brackets.mask(takes["unit"].isin(("count", "share")), "")
    column = takes["measure"] + unit
    named = takes.assign(column=column)
    wide = named.pivot(index="take", columns="column", values="value")
    order = takes.drop_duplicates("take").set_index("take")
    table = order[["part"]].join(wide[list(column.unique())])
    table["left_out"] = order["left_out"]
    table["reason"] = reasons_by_take(takes)
    return table.reset_index()


def require_enough(takes: pd.DataFrame) -> None:
    """Raise RecordingError where the limits leave fewer than FEWEST takes of a part."""
    for part_name, rows in takes.groupby("part", sort=False):
        left = rows.loc[~rows["left_out"], "take"].nunique()
        measures = rows.loc[rows["beyond"], "measure"].unique()
        if len(measures) and left < FEWEST:
            raise RecordingError(
                f"the limits leave {left} {part_name} take(s), {FEWEST} are required; takes "
                f"beyond the limits: {'; '.join(reasons(rows))}; record these takes again, or "
                "set other limits",
                key=", ".join(f"dataset.limits.{measure}" for measure in measures),
            )


def account(
    files: Iterable[pd.DataFrame],
    quality: pd.DataFrame,
    takes: pd.DataFrame,
) -> pd.DataFrame:
    """Return one row per step and recording: numbers found and kept, and what is left out."""
    rows = [_account_of_files([set(table["file"]) for table in files])]
    counts = quality[quality["quantity"].str.startswith((REPETITIONS, LEFT_OUT))]
    for movement, of_movement in counts.groupby("take"):
        number = of_movement.set_index("quantity")["value"].astype(int)
        lost = number[(number > 0) & (number.index != REPETITIONS)]
        words = []
        for quantity, count in lost.items():
            reason = quantity.removeprefix(LEFT_OUT).replace("_", " ")
            words.append(f"{reason} {count}")
        total = number.sum()
        repetitions = number[REPETITIONS]
        rows.append(("motions", movement, total, repetitions, ", ".join(words)))

    for part_name, of_part in takes.groupby("part", sort=False):
        number = of_part["take"].nunique()
        left = of_part.loc[~of_part["left_out"], "take"].nunique()
        rows.append(("takes", part_name, number, left, "; ".join(reasons(of_part))))
    columns = ["step", "recording", "found", "kept", "left_out"]
    return pd.DataFrame(rows, columns=columns)


def _account_of_files(files_by_part: list[set[str]]) -> tuple[str, str, int, int, str]:
    """Return the row of :func:`account` for the files: the files that no option names, which are
    listed by each part, are left out.
    """
    files = set().union(*files_by_part)
    unread = set.intersection(*files_by_part)
    places = Counter(name.partition("/")[0] for name in unread)

    words = []
    for place, number in sorted(places.items()):
        words.append(f"{place} ({number})" if number > 1 else place)
    return "files", "all", len(files), len(files - unread), ", ".join(words)
