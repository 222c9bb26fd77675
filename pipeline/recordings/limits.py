"""How good every take is beside the limits that the dataset states, and which takes stay."""

from __future__ import annotations

import pandas as pd

from pipeline.core.errors import RecordingError

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
