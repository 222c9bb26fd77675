"""What filters of the same takes are compared by: root mean square error and coverage of each
joint, and log score, of all steps and of those at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline.core.filters import NONE
from pipeline.statistics.filters import Filtered
from pipeline.statistics.take_scores import compared, posterior_scores

FIRST_ORDER = "first_order"  # the takes' spread as MEMORY has it, and a closed loop's correlation
YARDSTICK = "yardstick"  # knows the law of the arm's deviations
INFORMED = "yardstick_informed"  # and how the camera's error depends on the pose
RMS, COVERAGE, LOG = "rms error", "coverage", "log score"
AT_REST = "log score at rest"
ALL = "all"  # joints


def scored(
    filters: Mapping[str, Filtered], joints: Sequence[str], resting: np.ndarray
) -> pd.DataFrame:
    """A row for each of ``filters``, no filter among them, and each score: its mean over the takes,
    and the paired difference to no filter with its 95 % interval.

    Args:
        filters: by name, of equal takes.
        joints: names of the n joints.
        resting: (M+1,) whether no motion is commanded.
    """
    still = {
        name: Filtered(each.error[:, resting], each.covariance[:, resting], each.measurement)
        for name, each in filters.items()
    }
    everywhere, at_rest = (
        shown(
            compared(
                {
                    name: posterior_scores(each.error, each.covariance + each.measurement, joints)[
                        0
                    ]
                    for name, each in some.items()
                },
                NONE,
            ),
            joints,
        )
        for some in (filters, still)
    )
    at_rest = at_rest[at_rest["score"] == LOG].assign(score=AT_REST)
    return pd.concat([everywhere, at_rest], ignore_index=True)


def shown(table: pd.DataFrame, joints: Sequence[str]) -> pd.DataFrame:
    """Of the rows of :func:`pipeline.statistics.take_scores.compared` those of the scores above,
    with the columns filter, score, joint, mean, difference, low and high.
    """
    names = {f"rms_error_{joint}_rad": (RMS, joint) for joint in joints}
    names |= {f"coverage_of_one_sigma_{joint}": (COVERAGE, joint) for joint in joints}
    names |= {"log_score": (LOG, ALL)}
    rows = table[table["score"].isin(names)]
    split = [names[score] for score in rows["score"]]
    return pd.DataFrame(
        {
            "filter": rows["model"].to_numpy(),
            "score": [score for score, _ in split],
            "joint": [joint for _, joint in split],
        }
        | {column: rows[column].to_numpy(float) for column in ("mean", "difference", "low", "high")}
    )


def placed(rows: pd.DataFrame) -> pd.DataFrame:
    """``rows`` with the share ``gained`` of what the informed yardstick gains on no filter; a gap
    where that gains nothing beyond its interval.
    """
    best = rows[rows["filter"] == INFORMED].set_index(["score", "joint"])
    gains = (best["low"] > 0) | (best["high"] < 0)
    score = best.index.get_level_values("score")
    gains &= (best["difference"] > 0) == (score == LOG)
    gains &= score.isin((RMS, LOG))
    whole = best["difference"].where(gains).rename("whole")
    whole = rows.join(whole, on=["score", "joint"])["whole"]
    return rows.assign(gained=rows["difference"].where(rows["filter"] != NONE) / whole)


def verdicts(rows: pd.DataFrame) -> pd.DataFrame:
    """Of the ``rows`` of rms errors and log scores, whether the filter is ``better`` or ``worse``
    than no filter, beyond the interval; neither where there is none.
    """
    proper = rows[rows["score"].isin((RMS, LOG)) & (rows["filter"] != NONE)]
    falls, rises = proper["high"] < 0, proper["low"] > 0
    log = proper["score"] == LOG
    return proper.assign(better=rises.where(log, falls), worse=falls.where(log, rises))


def over_none(rows: pd.DataFrame) -> pd.Series:
    """The mean of each of ``rows`` over that of no filter."""
    return rows["mean"] / (rows["mean"] - rows["difference"].fillna(0.0))
