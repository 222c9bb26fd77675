"""Paths of all takes of a dataset, also of left-out takes: the table ``take_paths``, from which the
picture of the takes is drawn.
"""

import pandas as pd

from pipeline.arm.chain import Chain
from pipeline.core.columns import spread, values
from pipeline.recordings.quality import reasons_by_take

MOST_ROWS = 200  # of a take in a picture


def take_paths(joints: pd.DataFrame, takes: pd.DataFrame, chain: Chain) -> pd.DataFrame:
    """Return the rows of the table ``take_paths`` of all takes in ``joints``, at most MOST_ROWS of
    a take, in the order of the table ``takes``, which has the limits: measured joint angles, and
    the task coordinates of the tip.
    """
    reasons = reasons_by_take(takes)
    by_take = dict(list(joints.groupby("take", sort=False)))
    tables = []
    for take in takes["take"].unique():
        table = thinned(by_take[take]).drop(columns=["k", "residual"])
        tip = chain.coordinates(values(table, "q"))
        table = table.assign(**spread("x", chain.task, tip))
        table["left_out"] = take in reasons.index
        table["reason"] = reasons.get(take, "")
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def thinned(rows: pd.DataFrame) -> pd.DataFrame:
    """Return every n-th of the ``rows``, with the least n that leaves at most MOST_ROWS."""
    return rows.iloc[:: -(-len(rows) // MOST_ROWS)]
