"""Counts, losses and repairs of each take beside the dataset's limits; the takes that stay."""

from collections import Counter
from collections.abc import Iterable

import pandas as pd

from pipeline.core.errors import RecordingError

DEPTH_CAMERA = "depth camera"  # as the table names the instrument
# counts of a movement: its repetitions, which are takes, and its other motions, by reason
REPETITIONS, LEFT_OUT = "repetitions", "excursions_"
# quantities of the table ``quality`` that say how good a take is, whatever its length
MEASURES = (
    *("missing_share", "longest_gap", "interpolated", "relabelled_share", "residual_rms"),
    *("dropped_share", "clock_offset", "clock_offset_standard_error", "clock_drift"),
    *("clock_drift_standard_error", "lag_behind_command", "greatest_residual"),
    *("residual_beside_others", "disturbance"),
)
TWO_SIDED = ("clock_drift", "lag_behind_command")  # the size counts; elsewhere less is never worse
FEWEST = 2  # takes of a part: a covariance over takes, and leaving out each in turn, need another
SHOWN = 8  # folders whose files no part reads


def quality_row(
    take: str, part: str, instrument: str, quantity: str, value: float, unit: str = "count"
) -> dict[str, object]:
    """Return one row: ``quantity`` of ``instrument`` in ``take`` is ``value`` in ``unit``."""
    row = {"take": take, "part": part, "instrument": instrument, "quantity": quantity}
    return row | {"value": float(value), "unit": unit}


def summarised(quality: pd.DataFrame) -> pd.DataFrame:
    """Sum up ``quality`` by instrument and quantity: total of counts, mean of others, extremes."""
    summed = quality[quality["unit"] != "row"].groupby(["instrument", "quantity", "unit"])["value"]
    table = summed.agg(total="sum", mean="mean", least="min", greatest="max").reset_index()
    counted = table["unit"] == "count"
    return table.assign(total=table["total"].where(counted), mean=table["mean"].where(~counted))


def metrics(summary: pd.DataFrame) -> dict[str, float]:
    """Name totals of counts and means of the rest of :func:`summarised`."""
    names = summary["instrument"].str.replace(" ", "_") + "_" + summary["quantity"]
    names = names.where(summary["unit"] == "count", "mean_" + names)
    return dict(zip(names, summary["total"].fillna(summary["mean"]), strict=True))


def beside_limits(quality: pd.DataFrame, limits: dict[str, float | None]) -> pd.DataFrame:
    """Return the table ``takes`` of the table ``quality``: every measure of a take beside its limit
    (in the measure's unit; None: no limit), and whether the take is left out; training takes first.
    """
    takes = quality[quality["quantity"].isin(MEASURES)].rename(columns={"quantity": "measure"})
    takes = takes.assign(limit=takes["measure"].map(limits).astype(float))
    size = takes["value"].abs().where(takes["measure"].isin(TWO_SIDED), takes["value"])
    takes["beyond"] = size > takes["limit"]
    takes["left_out"] = takes["beyond"].groupby(takes["take"]).transform("any")
    takes["place"] = takes["measure"].map(MEASURES.index)
    order, ascending = ["part", "take", "place"], [False, True, True]
    takes = takes.sort_values(order, ascending=ascending, ignore_index=True)
    return takes.drop(columns=["instrument", "place"])


def _reasons(takes: pd.DataFrame) -> dict[str, str]:
    """Take → its measures beyond their limits, in words."""
    words: dict[str, str] = {}
    for row in takes[takes["beyond"]].itertuples():
        one = f"{row.measure} {row.value:.3g} beyond {row.limit:g}"
        words[row.take] = f"{words[row.take]}, {one}" if row.take in words else one
    return words


def reasons(takes: pd.DataFrame) -> list[str]:
    """Name every take that is left out and why, in the order of the table ``takes``."""
    return [f"{take} ({words})" for take, words in _reasons(takes).items()]


def side_by_side(takes: pd.DataFrame) -> pd.DataFrame:
    """Return a row a take of the table ``takes``: measures, whether and why it is left out."""
    unit = takes["unit"].map(lambda unit: "" if unit in ("count", "share") else f" ({unit})")
    column = takes["measure"] + unit
    wide = takes.assign(column=column).pivot(index="take", columns="column", values="value")
    order = takes.drop_duplicates("take").set_index("take")[["part", "left_out"]]
    table = order[["part"]].join(wide[list(dict.fromkeys(column))])
    reason = pd.Series(_reasons(takes), dtype="str")
    return table.assign(left_out=order["left_out"], reason=reason).reset_index()


def require_enough(takes: pd.DataFrame) -> None:
    """Raise RecordingError where the limits leave fewer than two takes of a part."""
    for part, rows in takes.groupby("part", sort=False):
        left_out = rows[rows["left_out"]]
        staying = rows["take"].nunique() - left_out["take"].nunique()
        if len(left_out) and staying < FEWEST:
            message = f"the limits leave {staying} {part} take(s) where {FEWEST} are needed; beyond"
            message += f" them are {'; '.join(reasons(rows))}: record these takes again, or state"
            beyond = left_out.loc[left_out["beyond"], "measure"].unique()
            keys = ", ".join(f"dataset.limits.{measure}" for measure in beyond)
            raise RecordingError(f"{message} other limits", key=keys)


def account(
    files: Iterable[pd.DataFrame], quality: pd.DataFrame, takes: pd.DataFrame
) -> pd.DataFrame:
    """Return a row per step and recording: found, kept, and what is left out in words."""
    names = [set(table["file"]) for table in files]
    present, other = set().union(*names), set.intersection(*names)  # unnamed: any part's
    places = Counter(name.partition("/")[0] for name in other)
    words = [f"{place} ({n})" if n > 1 else place for place, n in sorted(places.items())]
    more = [f"and in {len(words) - SHOWN} more places"] if len(words) > SHOWN else []
    words = ", ".join([*words[:SHOWN], *more])
    rows = [("files", "all", len(present), len(present - other), words)]
    counts = quality[quality["quantity"].str.startswith((REPETITIONS, LEFT_OUT))]
    for movement, of_movement in counts.groupby("take"):
        number = of_movement.set_index("quantity")["value"].astype(int)
        lost = number[(number > 0) & (number.index != REPETITIONS)]
        reason = lost.index.str.removeprefix(LEFT_OUT).str.replace("_", " ")
        words = ", ".join(f"{name} {count}" for name, count in zip(reason, lost, strict=True))
        rows.append(("motions", movement, number.sum(), number[REPETITIONS], words))
    for part, of_part in takes.groupby("part", sort=False):
        present = of_part["take"].nunique()
        gone = of_part.loc[of_part["left_out"], "take"].nunique()
        rows.append(("takes", part, present, present - gone, "; ".join(reasons(of_part))))
    return pd.DataFrame(rows, columns=["step", "recording", "found", "kept", "left_out"])
