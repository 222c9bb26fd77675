"""Deviations of the card's law from the limits of its predictions on held-out motions, and their
cause as far as the scores show it.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.models.joint_error.choice import (
    FEW,
    LAST_VALUE,
    QUARTER,
    left_out,
    pooled,
)
from pipeline.verdicts.wording import plain_name

RATIO = (2 / 3, 3 / 2)  # limits of predicted over measured σ
WITHIN = (0.58, 0.80)  # limits of the share of the errors within ±1σ
NORMAL = 0.683  # this share for normal errors
LOST = 0.5  # nats, summed over joints, that a law may lose to the best yardstick
YARDSTICKS = ("joint_constant", "joint_autoregression", LAST_VALUE)


class Deviation(NamedTuple):
    """Prediction of a joint at a horizon that is beyond RATIO or WITHIN."""

    joint: str
    horizon: str
    ratio: float
    one_sigma: float
    cause: str


def deviations(scores: pd.DataFrame, model: str) -> list[Deviation]:
    """Return the deviations of ``model`` in the commanded samples of ``scores``; joints with fewer
    than FEW samples have none.
    """
    of_model = scores[scores["model"] == model]
    commanded = of_model[of_model["samples"] == "commanded"]
    rows = []
    for (joint, horizon), group in commanded.groupby(["joint", "horizon"], sort=False):
        whole = pooled(group, ["joint"]).iloc[0]
        if whole["count"] < FEW or within_limits(whole):
            continue
        ratio = whole["ratio"]
        share = whole["one_sigma"]
        rows.append(Deviation(joint, horizon, ratio, share, cause_of(group)))
    return rows


def within_limits(numbers: pd.Series) -> bool:
    """Return True if ratio and share of ``numbers`` are within RATIO and WITHIN. A ratio to errors
    that are all 0 has no limits.
    """
    ratio = numbers["ratio"]
    share = numbers["one_sigma"]
    if not np.isnan(ratio) and not RATIO[0] <= ratio <= RATIO[1]:
        return False
    return WITHIN[0] <= share <= WITHIN[1]


def cause_of(group: pd.DataFrame) -> str:
    """Return the cause of a deviation of the scores ``group`` of a joint at a horizon: the held-out
    part without which ratio and share are within the limits, else the tails of the errors.
    """
    parts = left_out(group)
    whole = parts.iloc[0]
    without = parts.iloc[1:]
    inside = without[[within_limits(numbers) for _, numbers in without.iterrows()]]
    if len(inside):
        nearest = np.log(inside["ratio"]).abs().idxmin()
        row = inside.loc[nearest]
        places = group.drop_duplicates(["motion", "block"])
        part = part_name(places.iloc[nearest], len(places))
        numbers = f"{row['ratio']:.2f} and {row['one_sigma']:.2f}"
        return f"{part}, which the law does not predict: without it {numbers}"
    share = whole["one_sigma"]
    if share > NORMAL and whole["ratio"] < 1:
        return (
            "few large errors make the measured σ: "
            f"{share:.2f} of the errors are within ±1σ, {whole['two_sigma']:.2f} within ±2σ"
        )
    size = "large" if whole["ratio"] > 1 else "small"
    return f"σ is too {size} in more than one held-out part"


def part_name(place: pd.Series, parts: int) -> str:
    """Return the name of the held-out motion or block at ``place``, of ``parts`` of them."""
    motion = str(place["motion"])
    name = motion if motion.startswith(QUARTER) else f"motion {motion}"
    if parts > 1 and place["block"] > 1:
        name += f", block {place['block']}"
    return name


def losses(scores: pd.DataFrame, model: str) -> list[str]:
    """Return a sentence for each horizon at which a yardstick has a log score of more than LOST
    nats above that of ``model`` in the commanded samples of ``scores``.
    """
    commanded = scores[scores["samples"] == "commanded"]
    by_joint = pooled(commanded, ["model", "horizon", "joint"])["score"]
    totals = by_joint.groupby(level=["model", "horizon"], sort=False).sum()
    totals = totals.unstack("horizon", sort=False)
    yardsticks = [name for name in YARDSTICKS if name in totals.index and name != model]
    if not yardsticks:
        return []
    sentences = []
    for horizon in totals.columns:
        best = totals.loc[yardsticks, horizon].idxmax()
        above = totals.loc[best] - totals.loc[model]
        if not above[horizon] > LOST:
            continue
        of_joint = by_joint[best, horizon] - by_joint[model, horizon]
        elsewhere = []
        for name in totals.columns:
            if name != horizon:
                elsewhere.append(f"{above[name]:.2f} at {name}")
        sentences.append(
            f"At {horizon} the log score of {plain_name(best)} is {above[horizon]:.2f} nats "
            f"above that of the law, {of_joint.max():.2f} of them in {of_joint.idxmax()}. "
            f"This difference is {' and '.join(elsewhere)}; the law is fitted to all "
            "horizons together.",
        )
    return sentences
