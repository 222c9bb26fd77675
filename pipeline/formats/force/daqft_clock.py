"""Times of an ATI DAQ F/T log: by a column of times or sample numbers, else by the rate."""

from __future__ import annotations

import re

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import NUMBER
from pipeline.formats.force.clock import rate_of, seconds_of
from pipeline.formats.force.record import OPTION, LogOptions
from pipeline.formats.labels import bare, columns_of
from pipeline.formats.number_sheet import Sheet

TIMES = re.compile(r"t|time ?(stamp)?", re.IGNORECASE)
NUMBERS = re.compile(r"(sample|sequence|packet)( ?(number|no\.?|#))?", re.IGNORECASE)


def clock_of(
    sheet: Sheet,
    labels: list[str],
    stated: list[str | None],
    settings: dict[str, str],
    options: LogOptions,
    line: int,
) -> tuple[np.ndarray, float, bool]:
    """(N,) times in s, samples a second, and whether the log has times or sample numbers to tell
    them by.
    """
    named = (
        options.columns.get("t")
        if options.columns
        else next((i for i, label in enumerate(labels) if _is_clock(label)), None)
    )
    if named is None:
        rate = _rate(settings, options, sheet, line)
        return np.arange(len(sheet.rows)) / rate, rate, False
    column = columns_of(
        labels, {"t": named}, len(labels), file=sheet.file, line=line, key=f"{OPTION}.columns"
    )["t"]
    if NUMBERS.fullmatch(bare(labels[column])):
        rate, numbers = _rate(settings, options, sheet, line), sheet.values([column])[:, 0]
        return (numbers - numbers[0]) / rate, rate, True
    time = seconds_of(sheet, column, stated[column], options, line)
    return time, rate_of(time), True


def _is_clock(label: str) -> bool:
    return any(kind.fullmatch(bare(label)) for kind in (TIMES, NUMBERS))


def _rate(settings: dict[str, str], options: LogOptions, sheet: Sheet, line: int) -> float:
    """Samples a second: sampling frequency over averaging level, else the option's."""
    stated = []
    for key in ("Frequency", "Averaging Level"):
        text = settings.get(key)
        # in a culture of decimal commas a point is of thousands, or of another culture
        plain = text is not None and NUMBER.fullmatch(
            text if sheet.decimal == "." else text.replace(".", "?").replace(",", ".")
        )
        if not plain and options.rate is not None:
            return options.rate
        if not plain:
            problem = (
                f"state no {key}"
                if text is None
                else f"state {key} = {text}, which can be read in two ways or none"
            )
            message = f"the labels {problem}, so samples have no time; state the rate"
            raise RecordingError(message, file=sheet.file, line=line, key=f"{OPTION}.rate")
        stated.append(float(text.replace(sheet.decimal, ".")))
        if not 0 < stated[-1] < np.inf:
            raise RecordingError(
                f"{key} = {text} gives samples no time", file=sheet.file, line=line, key=key
            )
    rate = stated[0] / stated[1]
    if options.rate is not None and not np.isclose(options.rate, rate):
        message = f"the log states {rate:g} samples a second, the option {options.rate:g}"
        raise RecordingError(message, file=sheet.file, key=f"{OPTION}.rate")
    return rate
