"""Rule that chooses among joint error laws by their scores on held-out motions."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.statistics.takes import (
    Difference,
    jackknife_difference,
    paired_difference,
)

WRONG = 2.0  # greatest factor by which a standard deviation may be wrong at a horizon
RIGHT = (
    1.5  # greatest factor by which the standard deviation of a calibrated law is wrong
)
CONFIRMED = (
    1.4  # greatest factor in the interval of a standard deviation that is confirmed
)
COVERED = 0.8  # least share of the errors within two standard deviations
FEW = 20  # least number of commanded samples of a joint that moves
LONGEST = "0.5 s"  # the longest horizon
QUARTER = "quarter"  # in the name of a held-out part of a single motion
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


def margins(scores: pd.DataFrame, model: str, rival: str) -> tuple[float, float, float]:
    """Return mean and 95 % interval of the difference in log score of ``model`` to ``rival``, in
    nats a sample: the sum over joints, the mean over horizons. The interval is Student's t over
    held-out motions or blocks of them.
    """
    place = ["motion", "block", "horizon", "joint"]
    own, other = (
        scores[scores["model"] == name].set_index(place)["score"]
        for name in (model, rival)
    )
    joints = (own - other).groupby(["motion", "block", "horizon"]).sum()
    each = joints.groupby(["motion", "block"]).mean().dropna().to_numpy()
    if len(each) < 2:
        return float(each.mean()) if len(each) else np.nan, -np.inf, np.inf
    return paired_difference(each, np.zeros(len(each)))[:3]


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


def faults_of(scores: pd.DataFrame, model: str, factor: float = WRONG) -> list[str]:
    """Return what makes ``model`` unsound: joint, horizon, and the coverage, or the σ that is wrong
    by more than ``factor``.
    """
    own = pooled(scores[scores["model"] == model], ["joint", "horizon"]).query(
        "count >= @FEW"
    )
    faults = []
    for (joint, horizon), row in own.iterrows():
        if not 1 / factor <= row["ratio"] <= factor:
            found = f"predicted σ of {joint} at {horizon} is {row['ratio']:.2g} times the measured"
            faults.append(f"{found} (required: {1 / factor:.2g} to {factor:g})")
        if row["two_sigma"] < COVERED:
            found = f"{row['two_sigma']:.3g} of the errors of {joint} at {horizon} are within 2σ"
            faults.append(f"{found} (required: {COVERED:g})")
    return faults


def unconfirmed(scores: pd.DataFrame, model: str) -> list[dict[str, str]]:
    """Return the predicted σ of ``model`` that ``scores`` do not confirm: parameter (joint and
    horizon), found and required. The commanded samples confirm a σ if the 95 % interval of its
    ratio to the measured σ, over held-out motions or blocks, is within a factor of CONFIRMED.
    Quarters of a single motion confirm no σ on another motion. At rest :func:`faults_of` counts.
    """
    own = scores[(scores["model"] == model) & (scores["samples"] == "commanded")]
    entries = []
    if own["motion"].astype(str).str.startswith(QUARTER).any():
        entries.append(
            ("σ on another motion", "unknown: one motion was recorded", "2 motions")
        )
    for (joint, horizon), rows in own.groupby(["joint", "horizon"], sort=False):
        ratio, low, high = pooled_interval(left_out(rows), "ratio")[:3]
        if not (1 / CONFIRMED <= low and high <= CONFIRMED):
            found = f"{ratio:.3g} [{low:.3g}, {high:.3g}] times the measured σ"
            required = f"{1 / CONFIRMED:.3g} to {CONFIRMED:.3g}"
            entries.append((f"σ of {joint} at {horizon}", found, required))
    if resting := faults_of(scores[scores["samples"] == "at rest"], model):
        found = f"unusable, {len(resting)} fault(s): {resting[0].rpartition(' (')[0]}"
        entries.append(
            ("σ at rest", found, f"a factor of {WRONG:g}, {COVERED:g} within 2σ")
        )
    return [
        dict(zip(("parameter", "found", "required"), each, strict=True))
        for each in entries
    ]


def chosen_law(scores: pd.DataFrame) -> tuple[str | None, str]:
    """Return the law that the rule chooses by the commanded samples of ``scores``, or None, and the
    reason. Laws are listed from the simplest. A law replaces a simpler one if the interval of its
    margin is above zero, or if it alone is calibrated (σ wrong by at most RIGHT) and the interval
    is not below zero. An unsound law (:func:`faults_of`) is not chosen, and no law if no joint has
    FEW samples at the longest horizon.
    """
    moving = scores[scores["samples"] == "commanded"]
    if moving.empty:
        return None, "no joint was commanded to move"
    longest = (
        moving[moving["horizon"] == LONGEST].groupby(["model", "joint"])["count"].sum()
    )
    if (most := max(longest, default=0)) < FEW:
        found = (
            f"at most {most} commanded samples of a joint are predicted {LONGEST} ahead"
        )
        return None, f"{found} (required: {FEW}); record for longer"
    best, why, refused, calibrated = None, "", [], False
    for model in dict.fromkeys(moving["model"]):
        if faults := faults_of(moving, model):
            refused.append(f"{model}: {faults[0]}, {len(faults)} fault(s)")
            continue
        own = not faults_of(moving, model, RIGHT)
        if best is None:
            best, why, calibrated = model, "the simplest sound law", own
            continue
        mean, low, high = margins(moving, model, best)
        if low > 0 or (own and not calibrated and high >= 0):
            why = f"{mean:.3g} [{low:.3g}, {high:.3g}] nats a sample above {best}"
            if not low > 0:
                wrong = faults_of(moving, best, RIGHT)[0]
                why = f"it is calibrated, and {best} not: {wrong}; score {why}"
            best, calibrated = model, own
    if best is None:
        return None, "; ".join(refused)
    return best, why
