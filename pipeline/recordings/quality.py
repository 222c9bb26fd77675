"""Counts, losses and repairs of takes, comparison with the dataset's limits, and kept takes."""

from collections import Counter
from collections.abc import Iterable

import pandas as pd

from pipeline.core.errors import RecordingError

DEPTH_CAMERA = "depth camera"  # name of the instrument in the tables
# counts of a movement: repetitions (takes), and prefix of the counts of left-out motions by reason
REPETITIONS, LEFT_OUT = "repetitions", "excursions_"
# quantities of the table ``quality`` that do not depend on the length of a take
MEASURES = (
    "missing_share longest_gap interpolated relabelled_share residual_rms dropped_share "
    "clock_offset clock_offset_standard_error clock_drift clock_drift_standard_error "
    "camera_residual_share lag_behind_command lag_beside_others greatest_residual "
    "residual_beside_others disturbance likeness"
).split()
# measures whose limit applies to the absolute value
TWO_SIDED = ("clock_drift", "lag_behind_command", "lag_beside_others")
FEWEST = 2  # least number of takes of a part, for the covariance and for leaving one take out


def quality_row(
    take: str,
    part: str,
    instrument: str,
    quantity: str,
    value: float,
    unit: str = "count",
) -> dict[str, object]:
    """Return one row of the table ``quality``."""
    row = {"take": take, "part": part, "instrument": instrument, "quantity": quantity}
    return row | {"value": float(value), "unit": unit}


def summarise(quality: pd.DataFrame) -> pd.DataFrame:
    """Return, by instrument and quantity, total (of counts), mean (of others) and extremes."""
    summed = quality[quality["unit"] != "row"].groupby(
        ["instrument", "quantity", "unit"]
    )["value"]
    table = summed.agg(
        total="sum", mean="mean", least="min", greatest="max"
    ).reset_index()
    counted = table["unit"] == "count"
    return table.assign(
        total=table["total"].where(counted), mean=table["mean"].where(~counted)
    )


def beside_limits(
    quality: pd.DataFrame, limits: dict[str, float | None]
) -> pd.DataFrame:
    """Return the table ``takes`` from the table ``quality``: measures, their limits (in the unit of
    the measure; None: no limit), and whether a take is left out; training takes first.
    """
    takes = quality[quality["quantity"].isin(MEASURES)].rename(
        columns={"quantity": "measure"}
    )
    takes = takes.assign(limit=takes["measure"].map(limits).astype(float))
    size = takes["value"].abs().where(takes["measure"].isin(TWO_SIDED), takes["value"])
    takes["beyond"] = size > takes["limit"]
    takes["left_out"] = takes["beyond"].groupby(takes["take"]).transform("any")
    takes["place"] = takes["measure"].map(MEASURES.index)
    order, ascending = ["part", "take", "place"], [False, True, True]
    takes = takes.sort_values(order, ascending=ascending, ignore_index=True)
    return takes.drop(columns=["instrument", "place"])


def _reasons(takes: pd.DataFrame) -> pd.Series:
    """Return take → text of the measures beyond their limits."""
    beyond = takes[takes["beyond"]]
    words = [
        f"{row.measure} {row.value:.3g} beyond {row.limit:g}"
        for row in beyond.itertuples()
    ]
    words = pd.Series(words, beyond["take"], dtype="str")
    return words.groupby(level=0, sort=False).agg(", ".join)


def reasons(takes: pd.DataFrame) -> list[str]:
    """Return name and reason of every take that is left out, in the order of ``takes``."""
    return [f"{take} ({words})" for take, words in _reasons(takes).items()]


def side_by_side(takes: pd.DataFrame) -> pd.DataFrame:
    """Return one row per take of the table ``takes``: measures, whether and why it is left out."""
    unit = takes["unit"].map(
        lambda unit: "" if unit in ("count", "share") else f" ({unit})"
    )
    column = takes["measure"] + unit
    wide = takes.assign(column=column).pivot(
        index="take", columns="column", values="value"
    )
    order = takes.drop_duplicates("take").set_index("take")[["part", "left_out"]]
    table = order[["part"]].join(wide[list(dict.fromkeys(column))])
    return table.assign(
        left_out=order["left_out"], reason=_reasons(takes)
    ).reset_index()


def require_enough(takes: pd.DataFrame) -> None:
    """Raise RecordingError where the limits leave fewer than FEWEST takes of a part."""
    for part, rows in takes.groupby("part", sort=False):
        left = rows.loc[~rows["left_out"], "take"].nunique()
        beyond = rows.loc[rows["beyond"], "measure"].unique()
        if len(beyond) and left < FEWEST:
            message = f"the limits leave {left} {part} take(s), {FEWEST} are required; takes beyond"
            message += f" the limits: {'; '.join(reasons(rows))}; record these takes again, or set"
            keys = ", ".join(f"dataset.limits.{measure}" for measure in beyond)
            raise RecordingError(f"{message} other limits", key=keys)


def account(
    files: Iterable[pd.DataFrame], quality: pd.DataFrame, takes: pd.DataFrame
) -> pd.DataFrame:
    """Return one row per step and recording: numbers found and kept, and what is left out."""
    names = [set(table["file"]) for table in files]
    present, unread = (
        set().union(*names),
        set.intersection(*names),
    )  # unnamed: listed by each part
    places = Counter(name.partition("/")[0] for name in unread)
    words = ", ".join(
        f"{place} ({n})" if n > 1 else place for place, n in sorted(places.items())
    )
    rows = [("files", "all", len(present), len(present - unread), words)]
    counts = quality[quality["quantity"].str.startswith((REPETITIONS, LEFT_OUT))]
    for movement, of_movement in counts.groupby("take"):
        number = of_movement.set_index("quantity")["value"].astype(int)
        lost = number[(number > 0) & (number.index != REPETITIONS)]
        reason = lost.index.str.removeprefix(LEFT_OUT).str.replace("_", " ")
        words = ", ".join(
            f"{name} {count}" for name, count in zip(reason, lost, strict=True)
        )
        rows.append(("motions", movement, number.sum(), number[REPETITIONS], words))
    for part, of_part in takes.groupby("part", sort=False):
        found = of_part["take"].nunique()
        gone = of_part.loc[of_part["left_out"], "take"].nunique()
        rows.append(("takes", part, found, found - gone, "; ".join(reasons(of_part))))
    return pd.DataFrame(
        rows, columns=["step", "recording", "found", "kept", "left_out"]
    )
