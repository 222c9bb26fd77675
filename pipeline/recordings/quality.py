"""What was counted or measured of a recording: the rows of the table ``quality``.

The unit of a quantity declares how it is summed up over the takes: a ``count`` by its total, a
``row`` number not at all, everything else by its mean and its range.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.core.errors import RecordingError

DEPTH_CAMERA = "depth camera"  # as the table names the instrument
# counts of a movement: the repetitions in it that are takes, and its motions that are none, by why
REPETITIONS, LEFT_OUT = "repetitions", "excursions_"


def quality_row(
    take: str, part: str, instrument: str, quantity: str, value: float, unit: str = "count"
) -> dict[str, object]:
    """One row: ``quantity`` of ``instrument`` in ``take`` is ``value`` in ``unit``."""
    return {
        "take": take,
        "part": part,
        "instrument": instrument,
        "quantity": quantity,
        "value": float(value),
        "unit": unit,
    }


def require_text(path: Path) -> None:
    """RecordingError where the name of a take's file or folder is no text (not UTF-8): no table
    could name the take.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        shown = Path(repr(str(path))[1:-1])
        raise RecordingError(
            "the name holds letters that are no UTF-8; rename it", file=shown
        ) from None


def summarised(quality: pd.DataFrame) -> pd.DataFrame:
    """A row per instrument and quantity of the table ``quality``, summed up as its unit declares:
    instrument, quantity, unit, ``total`` or ``mean`` (the other is missing), least, greatest.
    """
    summed = quality[quality["unit"] != "row"].groupby(["instrument", "quantity", "unit"])["value"]
    table = summed.agg(total="sum", mean="mean", least="min", greatest="max").reset_index()
    counted = table["unit"] == "count"
    return table.assign(total=table["total"].where(counted), mean=table["mean"].where(~counted))


def metrics(summary: pd.DataFrame) -> dict[str, float]:
    """The numbers of :func:`summarised` by names of instrument and quantity: totals of counts,
    means of the rest.
    """
    names = summary["instrument"].str.replace(" ", "_") + "_" + summary["quantity"]
    counted = summary["unit"] == "count"
    names = names.where(counted, "mean_" + names)
    return dict(zip(names, summary["total"].where(counted, summary["mean"]), strict=True))


def side_by_side(takes: pd.DataFrame) -> pd.DataFrame:
    """One row a take of the table ``takes``: what tells how good it is, whether it is left out, and
    why.
    """
    unit = takes["unit"].map(lambda unit: "" if unit in ("count", "share") else f" ({unit})")
    column = takes["measure"] + unit
    value, limit = takes["value"].map("{:.3g}".format), takes["limit"].map("{:g}".format)
    why = (takes["measure"] + " " + value + " beyond " + limit)[takes["beyond"]]
    wide = takes.assign(column=column).pivot(index="take", columns="column", values="value")
    order = takes.drop_duplicates("take").set_index("take")[["part", "left_out"]]
    reasons = why.groupby(takes["take"]).agg("; ".join)
    table = order[["part"]].join(wide[list(dict.fromkeys(column))])
    return table.assign(left_out=order["left_out"], reason=reasons).reset_index()
