"""What the times of a force record tell: rows written twice, jitter, gaps."""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import OPTION, ForceLogOptions
from pipeline.formats.number_sheet import Sheet
from pipeline.formats.units import TIME_UNITS, spelled

JITTER = 0.1  # of the median step


def read_clock(
    time: np.ndarray, values: np.ndarray, places: list[int], *, place: str, file: object
) -> tuple[np.ndarray, dict[str, int]]:
    """Which of N samples to keep (N,), and what their ``time`` (N,) in s shows of ``values`` (N,
    axes).

    Counts: ``doubled_rows`` (the same sample at the same time, not kept), ``equal_times`` (another
    sample at the same time, kept), ``uneven_steps`` (off the median by more than a tenth of it:
    jitter) and ``missing_samples`` (that would fit into the longer steps). Raises RecordingError,
    with the number in ``places`` (N) of the ``place`` (line, sample) there, for a time that goes
    back, and for one that most samples share with the one before.
    """
    steps = np.diff(time)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0)) + 1
        raise RecordingError(
            f"the time goes back to {time[row]:.9g} s", file=file, **{place: places[row]}
        )
    doubled = (steps == 0) & (values[1:] == values[:-1]).all(axis=1)
    keep = np.append(True, ~doubled)
    steps = np.diff(time[keep])
    median = float(np.median(steps)) if len(steps) else 0.0
    if len(steps) and median == 0:
        raise RecordingError(
            "most samples share their time with the one before: no clock",
            file=file,
            **{place: places[0]},
        )
    return keep, {
        "doubled_rows": int(doubled.sum()),
        "equal_times": int(np.sum(steps == 0)),
        "uneven_steps": int(np.sum(np.abs(steps - median) > JITTER * median)),
        "missing_samples": int(np.sum(np.rint(steps[steps > 1.5 * median] / median) - 1)),
    }


def rate_of(time: np.ndarray) -> float:
    """Samples a second by the median step of ``time`` (N,) in s; NaN of a single sample."""
    return float(1 / np.median(np.diff(time))) if len(time) > 1 else float("nan")


def seconds_of(
    sheet: Sheet, column: int, stated: str | None, options: ForceLogOptions
) -> np.ndarray:
    """Return (N,) s from the first on: the ``column`` of times, in the unit that the log has
    ``stated``, else of the option.

    RecordingError with the option that settles it where neither states a unit that is known, or
    each another.
    """
    stated = spelled(stated) if stated else None
    unit = stated or options.time_unit
    where = {"file": sheet.file, "line": sheet.label_line, "key": f"{OPTION}.time_unit"}
    if unit not in TIME_UNITS:
        problem = f"the time has no known unit{f' ({unit!r})' if unit else ''}"
        raise RecordingError(f"{problem}: state one of {', '.join(TIME_UNITS)}", **where)
    if stated and options.time_unit and stated != spelled(options.time_unit):
        message = f"the time is in {stated} by the log and in {options.time_unit} by the option"
        raise RecordingError(message, **where)
    ticks = sheet.values([column])[:, 0]
    return (ticks - ticks[0]) * TIME_UNITS[unit]
