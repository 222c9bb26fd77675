"""What was found, lost and repaired in each take, beside the limits that the dataset states; which
takes stay, and what was left out and why.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from pipeline.core.errors import RecordingError

DEPTH_CAMERA = "depth camera"  # as the table names the instrument
# counts of a movement: the repetitions in it that are takes, and its motions that are none, by why
REPETITIONS, LEFT_OUT = "repetitions", "excursions_"
# quantities of the table ``quality`` that tell how good a take is, whatever its length
MEASURES = (
    "missing_share",
    "longest_gap",
    "interpolated",
    "relabelled_share",
    "residual_rms",
    "dropped_share",
    "clock_offset",
    "clock_offset_standard_error",
    "clock_drift",
    "clock_drift_standard_error",
    "lag_behind_command",
    "greatest_residual",
    "residual_beside_others",
    "disturbance",
)
TWO_SIDED = ("clock_drift", "lag_behind_command")  # of the others less is never worse
FEWEST = 2  # takes of a part: a covariance over takes, and leaving out each in turn, need another
SHOWN = 8  # folders whose files no part reads


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


def beside_limits(quality: pd.DataFrame, limits: dict[str, float | None]) -> pd.DataFrame:
    """The table ``takes`` from the table ``quality``: every measure of a take beside its limit, and
    whether the take is left out.

    ``limits`` by measure, in the measure's unit; a measure that is absent or None there has none.
    Of a measure that may be off to either side the size counts. Training takes come first, in the
    order of their names.
    """
    takes = quality[quality["quantity"].isin(MEASURES)].rename(columns={"quantity": "measure"})
    takes = takes.assign(
        limit=takes["measure"]
        .map({name: limit for name, limit in limits.items() if limit is not None})
        .astype(float)
    )
    size = takes["value"].abs().where(takes["measure"].isin(TWO_SIDED), takes["value"])
    takes["beyond"] = size > takes["limit"]
    takes["left_out"] = takes["beyond"].groupby(takes["take"]).transform("any")
    takes["place"] = takes["measure"].map(MEASURES.index)
    takes = takes.sort_values(
        ["part", "take", "place"], ascending=[False, True, True], ignore_index=True
    )
    return takes.drop(columns=["instrument", "place"])


def reasons(takes: pd.DataFrame) -> list[str]:
    """Every take that is left out and why, in words, in the order of the table ``takes``."""
    measures: dict[str, list[str]] = {}
    for row in takes[takes["beyond"]].itertuples():
        words = f"{row.measure} {row.value:.3g} beyond {row.limit:g}"
        measures.setdefault(row.take, []).append(words)
    return [f"{take} ({', '.join(words)})" for take, words in measures.items()]


def require_enough(takes: pd.DataFrame) -> None:
    """RecordingError where the limits leave fewer than two takes of a part: it names the limits and
    the takes beyond them.
    """
    for part, rows in takes.groupby("part", sort=False):
        left_out = rows[rows["left_out"]]
        staying = rows["take"].nunique() - left_out["take"].nunique()
        if len(left_out) and staying < FEWEST:
            beyond = left_out.loc[left_out["beyond"], "measure"].unique()
            raise RecordingError(
                f"the limits leave {staying} {part} take(s) where {FEWEST} are needed; beyond "
                f"them are {'; '.join(reasons(rows))}: "
                "record these takes again, or state other limits",
                key=", ".join(f"dataset.limits.{measure}" for measure in beyond),
            )


def account(
    files: Iterable[pd.DataFrame], quality: pd.DataFrame, takes: pd.DataFrame
) -> pd.DataFrame:
    """A row per step and recording: step, recording, ``found``, ``kept``, ``left_out`` in words.

    Args:
        files: The files that each part reads, as
            :func:`pipeline.recordings.inventory.by_part` has them.
        quality: The table ``quality`` of the motion.
        takes: The table ``takes``.
    """
    rows = [("files", "all", *_named(files))]
    counts = quality[quality["quantity"].str.startswith((REPETITIONS, LEFT_OUT))]
    for movement, held in counts.groupby("take"):
        number = held.set_index("quantity")["value"].astype(int)
        lost = number.drop(REPETITIONS)
        words = [
            f"{name.removeprefix(LEFT_OUT).replace('_', ' ')} {count}"
            for name, count in lost[lost > 0].items()
        ]
        rows.append(("motions", movement, number.sum(), number[REPETITIONS], ", ".join(words)))
    for part, of_part in takes.groupby("part", sort=False):
        present = of_part["take"].nunique()
        gone = of_part.loc[of_part["left_out"], "take"].nunique()
        rows.append(("takes", part, present, present - gone, "; ".join(reasons(of_part))))
    return pd.DataFrame(rows, columns=["step", "recording", "found", "kept", "left_out"])


def _named(files: Iterable[pd.DataFrame]) -> tuple[int, int, str]:
    """How many files there are, how many a pattern names, and where the others lie."""
    names = [set(table["file"]) for table in files]
    present, other = set().union(*names), set.intersection(*names)  # what none names is any part's
    places = Counter(name.partition("/")[0] for name in other)
    words = [
        place if number == 1 else f"{place} ({number})" for place, number in sorted(places.items())
    ]
    more = [f"and in {len(words) - SHOWN} more places"] if len(words) > SHOWN else []
    return len(present), len(present - other), ", ".join([*words[:SHOWN], *more])
