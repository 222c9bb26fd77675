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
CONFIRMED = (
    1.4  # greatest factor in the interval of a standard deviation that is confirmed
)
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
    values = scores[NUMBERS].fillna(0.0).join(scores[SIGMAS] ** 2)
    parts = scores[[*by, "count"]].join(values.mul(scores["count"], axis=0))
    sums = parts.groupby([*by], sort=False).sum()
    sums[values.columns] = sums[values.columns].div(sums["count"], axis=0)
    sums[SIGMAS] = np.sqrt(sums[SIGMAS])
    sums["ratio"] = sums["predicted_rad"] / sums["measured_rad"].where(
        sums["measured_rad"] > 0
    )
    return sums


def mean_scores(scores: pd.DataFrame) -> pd.DataFrame:
    """Return the log scores in nats a sample by held-out motion or block (rows) and model
    (columns): sums over joints, means over horizons.
    """
    part = ["motion", "block"]
    joints = scores.groupby([*part, "horizon", "model"], sort=False)["score"].sum()
    return joints.groupby([*part, "model"], sort=False).mean().unstack(sort=False)


def margins(scores: pd.DataFrame, model: str, rival: str) -> tuple[float, float, float]:
    """Return mean and 95 % interval of the difference in log score of ``model`` to ``rival``, in
    nats a sample (:func:`mean_scores`). The interval is Student's t over held-out motions or blocks
    of them.
    """
    by_part = mean_scores(scores)
    gains = (by_part[model] - by_part[rival]).dropna().to_numpy()
    if len(gains) < 2:
        return float(gains.mean()) if len(gains) else np.nan, -np.inf, np.inf
    return paired_difference(gains, np.zeros(len(gains)))[:3]


def left_out(scores: pd.DataFrame) -> pd.DataFrame:
    """Return the :func:`pooled` numbers of ``scores`` as the first row, then without each of the
    held-out motions or blocks.
    """
    parts = scores.groupby(["motion", "block"], sort=False).ngroup().to_numpy()
    kept = [
        np.arange(len(scores)),
        *(np.flatnonzero(parts != part) for part in np.unique(parts)),
    ]
    without = np.repeat(np.arange(len(kept)), [*map(len, kept)])
    return pooled(
        scores.iloc[np.concatenate(kept)].assign(without=without), ["without"]
    )


def pooled_interval(parts: pd.DataFrame, name: str) -> Difference:
    """Return the ratio or share ``name`` in the first of ``parts`` (:func:`left_out`), with the
    interval of the jackknife: of the logarithm of the ratio, and within 0 to 1 for a share.
    """
    values = parts[name].to_numpy()
    if len(values) < 3:
        return Difference(values[0])
    if name == "ratio":
        found = jackknife_difference(np.log(values))
        return Difference(
            values[0], float(np.exp(found.low)), float(np.exp(found.high))
        )
    found = jackknife_difference(values)
    return found._replace(low=max(found.low, 0.0), high=min(found.high, 1.0))


def faults_of(scores: pd.DataFrame, model: str) -> list[str]:
    """Return what makes ``model`` unsound: joint, horizon, and the coverage, or the σ that is wrong
    by more than a factor of WRONG, or of GROSS for less than FEW samples.
    """
    by_horizon = pooled(scores[scores["model"] == model], ["joint", "horizon"])
    faults = []
    for (joint, horizon), row in by_horizon.iterrows():
        few = row["count"] < FEW
        factor = GROSS if few else WRONG
        if np.isfinite(row["ratio"]) and not 1 / factor <= row["ratio"] <= factor:
            found = f"predicted σ of {joint} at {horizon} is {row['ratio']:.2g} times the measured"
            faults.append(f"{found} (required: {1 / factor:.2g} to {factor:g})")
        if row["two_sigma"] < COVERED and not few:
            found = f"{row['two_sigma']:.3g} of the errors of {joint} at {horizon} are within 2σ"
            faults.append(f"{found} (required: {COVERED:g})")
    return faults


def confirmations(scores: pd.DataFrame, model: str) -> pd.DataFrame:
    """Return for each joint and horizon ``ratio``, predicted over measured σ of ``model`` in the
    commanded samples of ``scores``, the ends ``low`` and ``high`` of its 95 % interval over
    held-out motions or blocks (NaN for fewer than two), and whether the interval is
    ``confirmed``: within a factor of CONFIRMED.
    """
    chosen = (scores["model"] == model) & (scores["samples"] == "commanded")
    rows = []
    for (joint, horizon), group in scores[chosen].groupby(
        ["joint", "horizon"], sort=False
    ):
        ratio, low, high = pooled_interval(left_out(group), "ratio")[:3]
        confirmed = bool(1 / CONFIRMED <= low and high <= CONFIRMED)
        rows.append((joint, horizon, ratio, low, high, confirmed))
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
    if of_model["motion"].astype(str).str.startswith(QUARTER).any():
        entries.append(
            ("σ on another motion", "unknown: one motion was recorded", "2 motions")
        )
    required = f"{1 / CONFIRMED:.3g} to {CONFIRMED:.3g}"
    for _, row in confirmations(scores, model).iterrows():
        if not row["confirmed"]:
            found = f"{ratio_with_interval(row)} times the measured σ"
            name = f"σ of {row['joint']} at {row['horizon']}"
            entries.append((name, found, required))
    if resting := faults_of(of_model[of_model["samples"] == "at rest"], model):
        found = f"unusable, {len(resting)} fault(s): {resting[0].rpartition(' (')[0]}"
        entries.append(
            ("σ at rest", found, f"a factor of {WRONG:g}, {COVERED:g} within 2σ")
        )
    keys = ("parameter", "found", "required")
    return [dict(zip(keys, entry, strict=True)) for entry in entries]


def chosen_law(scores: pd.DataFrame) -> tuple[str | None, str]:
    """Return the law that the rule chooses by the commanded samples of ``scores``, or None, and the
    reason. It is the sound law (:func:`faults_of`) with the highest mean log score over held-out
    motions or blocks (:func:`mean_scores`); the mean is the best guess also where its interval
    includes other laws. No law is chosen if no joint has FEW samples at the longest horizon.
    """
    moving = scores[
        (scores["samples"] == "commanded") & (scores["model"] != LAST_VALUE)
    ]
    if moving.empty:
        return None, "no joint was commanded to move"
    farthest = moving[moving["horizon"] == LONGEST]
    counts = farthest.groupby(["model", "joint"])["count"].sum()
    if (most := max(counts, default=0)) < FEW:
        found = (
            f"at most {most} commanded samples of a joint are predicted {LONGEST} ahead"
        )
        return None, f"{found} (required: {FEW}); record for longer"
    sound, refused = [], []
    for model in dict.fromkeys(moving["model"]):
        if faults := faults_of(moving, model):
            refused.append(f"{model}: {faults[0]}, {len(faults)} fault(s)")
        else:
            sound.append(model)
    if not sound:
        return None, "; ".join(refused)
    means = (
        mean_scores(moving)[sound].mean().sort_values(ascending=False, kind="stable")
    )
    best, *others = means.index
    if not others:
        return best, "the only sound law"
    mean, low, high = margins(moving, best, others[0])
    interval = f"[{low:.3g}, {high:.3g}]" if np.isfinite(low) else "(no interval)"
    found = f"{mean:.3g} {interval} nats a sample above {others[0]}"
    return best, f"highest mean log score of {len(sound)} sound laws, {found}"
