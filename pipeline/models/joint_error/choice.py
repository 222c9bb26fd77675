"""Rule of the model card: law of the joint error that is chosen by the scores on held-out motions,
and predicted standard deviations that they confirm.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.statistics.takes import (
    Difference,
    jackknife_difference,
    paired_difference,
)

WRONG = 2.0  # greatest factor by which a standard deviation may be wrong at a horizon
CONFIRMED = 1.4  # greatest factor in the interval of a confirmed standard deviation
GROSS = 10.0  # the same for a joint with few commanded samples
COVERED = 0.8  # least share of the errors within two standard deviations
FEW = 20  # least number of commanded samples of a joint that moves
LONGEST = "0.5 s"  # the longest horizon
QUARTER = "quarter"  # in the name of a held-out part of a single motion
LAST_VALUE = "last_value"  # yardstick in the scores: the last error, with σ by horizon
SHARES = ["one_sigma", "two_sigma"]
NUMBERS = ["score", *SHARES, "autocorrelation"]
SIGMAS = ["predicted_rad", "measured_rad"]


def pooled(scores: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Return the rows of ``scores`` (table joint_scores) joined by the columns ``by``: means and
    mean squares weighted by the number of errors, and ``ratio``, predicted over measured σ.
    """
    scores = scores.reset_index(drop=True)
    means = scores[NUMBERS].fillna(0.0)
    means[SIGMAS] = scores[SIGMAS] ** 2
    sums = means.mul(scores["count"], axis=0)
    groups = scores[[*by, "count"]]
    result = sums.join(groups).groupby([*by], sort=False).sum()
    columns = means.columns
    result[columns] = result[columns].div(result["count"], axis=0)
    result[SIGMAS] = np.sqrt(result[SIGMAS])
    measured = result["measured_rad"]
    positive = measured.where(measured > 0)
    result["ratio"] = result["predicted_rad"] / positive
    return result


def mean_scores(scores: pd.DataFrame) -> pd.DataFrame:
    """Return the log scores in nats a sample by held-out motion or block (rows) and model
    (columns): sums over joints, means over horizons.
    """
    keys = ["motion", "block", "horizon", "model"]
    by_horizon = scores.groupby(keys, sort=False)["score"].sum()
    by_model = by_horizon.groupby(["motion", "block", "model"], sort=False).mean()
    return by_model.unstack(sort=False)


def margins(scores: pd.DataFrame, model: str, rival: str) -> tuple[float, float, float]:
    """Return mean and 95 % interval of the difference in log score of ``model`` to ``rival``, in
    nats a sample (:func:`mean_scores`). The interval is Student's t over held-out motions or blocks
    of them.
    """
    means = mean_scores(scores)
    gains = means[model] - means[rival]
    gains = gains.dropna().to_numpy()
    if len(gains) == 0:
        return np.nan, -np.inf, np.inf
    if len(gains) == 1:
        (gain,) = gains
        return float(gain), -np.inf, np.inf
    zero = np.zeros(len(gains))
    difference = paired_difference(gains, zero)
    return difference[:3]


def left_out(scores: pd.DataFrame) -> pd.DataFrame:
    """Return the :func:`pooled` numbers of ``scores`` as the first row, then without each of the
    held-out motions or blocks.
    """
    numbers = scores.groupby(["motion", "block"], sort=False).ngroup()
    tables = [scores.assign(without=-1)]
    for number in numbers.unique():
        remaining = scores[numbers != number]
        tables.append(remaining.assign(without=number))
    return pooled(pd.concat(tables), ["without"])


def pooled_interval(parts: pd.DataFrame, name: str) -> Difference:
    """Return the ratio or share ``name`` in the first of ``parts`` (:func:`left_out`), with the
    interval of the jackknife: of the logarithm of the ratio, and within 0 to 1 for a share.
    """
    values = parts[name].to_numpy()
    if len(values) < 3:
        return Difference(values[0])
    if name == "ratio":
        logarithm = jackknife_difference(np.log(values))
        ends = np.exp([logarithm.low, logarithm.high])
        low, high = ends.tolist()
        return Difference(values[0], low, high)
    share = jackknife_difference(values)
    low = max(share.low, 0.0)
    high = min(share.high, 1.0)
    return share._replace(low=low, high=high)


def faults_of(scores: pd.DataFrame, model: str) -> list[str]:
    """Return what makes ``model`` unsound: joint, horizon, and the coverage, or the σ that is wrong
    by more than a factor of WRONG, or of GROSS for less than FEW samples.
    """
    by_horizon = pooled(scores[scores["model"] == model], ["joint", "horizon"])
    faults = []
    for (joint, horizon), row in by_horizon.iterrows():
        few = row["count"] < FEW
        factor = GROSS if few else WRONG
        ratio = row["ratio"]
        covered = row["two_sigma"]
        if np.isfinite(ratio) and not 1 / factor <= ratio <= factor:
            faults.append(
                f"predicted σ of {joint} at {horizon} is {ratio:.2g} times the measured "
                f"(required: {1 / factor:.2g} to {factor:g})",
            )
        if covered < COVERED and not few:
            faults.append(
                f"{covered:.3g} of the errors of {joint} at {horizon} are within 2σ "
                f"(required: {COVERED:g})",
            )
    return faults


def confirmations(scores: pd.DataFrame, model: str) -> pd.DataFrame:
    """Return for each joint and horizon ``ratio``, predicted over measured σ of ``model`` in the
    commanded samples of ``scores``, the ends ``low`` and ``high`` of its 95 % interval over
    held-out motions or blocks (NaN for fewer than two), and whether the interval is
    ``confirmed``: within a factor of CONFIRMED.
    """
    commanded = scores[scores["samples"] == "commanded"]
    of_model = commanded[commanded["model"] == model]
    rows = []
    for (joint, horizon), group in of_model.groupby(["joint", "horizon"], sort=False):
        ratio = pooled_interval(left_out(group), "ratio")
        row = {
            "joint": joint,
            "horizon": horizon,
            "ratio": ratio.difference,
            "low": ratio.low,
            "high": ratio.high,
            "confirmed": 1 / CONFIRMED <= ratio.low and ratio.high <= CONFIRMED,
        }
        rows.append(row)
    columns = ["joint", "horizon", "ratio", "low", "high", "confirmed"]
    return pd.DataFrame(rows, columns=columns)


def ratio_with_interval(row: pd.Series) -> str:
    """Return ratio and interval of a row of :func:`confirmations` in words."""
    if np.isnan(row["low"]):
        return f"{row['ratio']:.3g} (too few parts for an interval)"
    return f"{row['ratio']:.3g} [{row['low']:.3g}, {row['high']:.3g}]"


def unconfirmed(scores: pd.DataFrame, model: str) -> list[dict[str, str]]:
    """Return the predicted σ of ``model`` that ``scores`` do not confirm (:func:`confirmations`):
    parameter (joint and horizon), found and required. Quarters of a single motion confirm no σ on
    another motion. At rest :func:`faults_of` counts.
    """
    of_model = scores[scores["model"] == model]
    entries = []

    def add(parameter: str, finding: str, required: str) -> None:
        entry = {"parameter": parameter, "found": finding, "required": required}
        entries.append(entry)

    if of_model["motion"].astype(str).str.startswith(QUARTER).any():
        add("σ on another motion", "unknown: one motion was recorded", "2 motions")
    for _, row in confirmations(scores, model).iterrows():
        if not row["confirmed"]:
            add(
                f"σ of {row['joint']} at {row['horizon']}",
                f"{ratio_with_interval(row)} times the measured σ",
                f"{1 / CONFIRMED:.3g} to {CONFIRMED:.3g}",
            )
    if faults := faults_of(of_model[of_model["samples"] == "at rest"], model):
        first = faults[0].rpartition(" (")[0]
        add(
            "σ at rest",
            f"unusable, {len(faults)} fault(s): {first}",
            f"a factor of {WRONG:g}, {COVERED:g} within 2σ",
        )
    return entries


def chosen_law(scores: pd.DataFrame) -> tuple[str | None, str]:
    """Return the law that the rule chooses by the commanded samples of ``scores``, or None, and the
    reason. It is the sound law (:func:`faults_of`) with the highest mean log score over held-out
    motions or blocks (:func:`mean_scores`); the mean is the best guess also where its interval
    includes other laws. No law is chosen if no joint has FEW samples at the longest horizon.

    Cost of the rule, simulated (``tests/laboratory/test_recommendation.py``): of two laws whose
    true margin has a standard deviation of 1 nat, and varies by as much from block to block, the
    chosen one loses on average 0.06, 0.06 and 0.02 nats a sample to the better one with 2, 4 and 8
    blocks; a rule that requires an interval above zero loses 0.31, 0.28 and 0.16.
    """
    commanded = scores[scores["samples"] == "commanded"]
    moving = commanded[commanded["model"] != LAST_VALUE]
    if moving.empty:
        return None, "no joint was commanded to move"
    farthest = moving[moving["horizon"] == LONGEST]
    counts = farthest.groupby(["model", "joint"])["count"].sum()
    most = max(counts, default=0)
    if most < FEW:
        reason = (
            f"at most {most} commanded samples of a joint are predicted {LONGEST} ahead"
        )
        return None, f"{reason} (required: {FEW}); record for longer"
    sound = []
    unsound = []
    for model in moving["model"].unique():
        faults = faults_of(moving, model)
        if faults:
            unsound.append(f"{model}: {faults[0]}, {len(faults)} fault(s)")
        else:
            sound.append(model)
    if not sound:
        return None, "; ".join(unsound)
    means = mean_scores(moving)[sound].mean()
    best, *rivals = means.sort_values(ascending=False, kind="stable").index
    if not rivals:
        return best, "the only sound law"
    mean, low, high = margins(moving, best, rivals[0])
    interval = "(no interval)"
    if np.isfinite(low):
        interval = f"[{low:.3g}, {high:.3g}]"
    margin = f"{mean:.3g} {interval} nats a sample above {rivals[0]}"
    return best, f"highest mean log score of {len(sound)} sound laws, {margin}"
