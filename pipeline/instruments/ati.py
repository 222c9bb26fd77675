"""ATI DAQ F/T logs: six axes of force and torque as the sensor's own .NET program writes them, in the culture of its PC.

A first line may tell what was skipped; then one row of labels, whose last four are settings (``Frequency = 1000``) and have no column
under them; then one quoted row a sample, without its time. Cultures with a decimal comma separate cells by semicolons.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import cells_of, is_blank, numbers_of, read_text

FORCE_UNITS = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605}  # N
TORQUE_UNITS = {"Nm": 1.0, "Nmm": 1e-3, "kNm": 1e3, "lbfin": 4.4482216152605 * 0.0254, "lbfft": 4.4482216152605 * 0.3048}  # N·m
LABEL = re.compile(r"(Force|Torque) ([XYZ])\s*(?:\((.*)\))?")
DELAY = re.compile(r"(Paused for|Skipped)\s+(\d+)")


@dataclass(frozen=True)
class ForceRecord:
    """N samples of one sensor in the sensor's frame."""

    time: np.ndarray  # (N,) s since the first recorded sample, from frequency and averaging level
    force: np.ndarray  # (N, 3) N
    torque: np.ndarray  # (N, 3) N·m, NaN where the log holds forces alone
    rate: float  # Hz, sampling frequency over averaging level
    serial: str
    started: str  # as the PC printed it
    counts: dict[str, int]  # see read_daqft


def read_daqft(file: Path) -> ForceRecord:
    """Record in ``file``, in N, N·m and s.

    ``counts``: ``repeated_rows`` (equal to the row before) and ``zero_rows``, both kept; ``blank_rows``; ``cut_rows`` (a last row without
    line end: the program was stopped while it wrote, so the row is dropped); ``paused_ms`` or ``skipped_samples`` between the start
    and the first sample.

    Raises RecordingError, with the line where there is one, for gauge voltages, a label without a known unit, an axis that is missing or
    named twice, a header without frequency or averaging level, no sample, and malformed rows.
    """
    text = read_text(file)
    delay = DELAY.match(text.lines[0]) if text.lines else None
    top = 1 if delay else 0
    if len(text.lines) <= top:
        raise RecordingError("the row of labels is missing or cut", file=file, line=top + 1)
    line = text.lines[top]
    separator = max(";\t,", key=line.count)
    labels = cells_of(line, separator, file=file, number=top + 1)
    settings = dict(re.split(r"\s*=\s*", label, maxsplit=1) for label in labels if "=" in label)
    columns = _columns([label for label in labels if "=" not in label], file, top + 1)

    rows, numbers = [], []
    for number, row in enumerate(text.lines[top + 1 :], start=top + 2):
        if not is_blank(row, separator):
            rows.append(row)
            numbers.append(number)
    if not rows:
        raise RecordingError("the labels are followed by no whole sample; record again", file=file, line=top + 1)
    width = len(labels) - len(settings)
    if rows[0].count(separator) + 1 != width:
        raise RecordingError(f"the row has {rows[0].count(separator) + 1} cells under {width} labels", file=file, line=numbers[0])
    decimal = "," if separator != "," and any("," in row for row in rows) else "."
    rate = _setting(settings, "Frequency", decimal, file, top + 1) / _setting(settings, "Averaging Level", decimal, file, top + 1)
    values = numbers_of(rows, numbers, [column for column, _ in columns], file=file, separator=separator, decimal=decimal)
    values *= [unit for _, unit in columns]

    counts = {
        "repeated_rows": int((values[1:] == values[:-1]).all(axis=1).sum()),
        "zero_rows": int((values == 0).all(axis=1).sum()),
        "blank_rows": len(text.lines) - top - 1 - len(rows),
        "cut_rows": int(text.cut is not None),
    }
    if delay:
        counts["paused_ms" if delay[1] == "Paused for" else "skipped_samples"] = int(delay[2])
    torque = values[:, 3:] if len(columns) == 6 else np.full((len(values), 3), np.nan)
    started = settings.get("Time Started", "")
    return ForceRecord(np.arange(len(values)) / rate, values[:, :3], torque, rate, settings.get("F/T Serial Number", ""), started, counts)


def _columns(labels: list[str], file: Path, line: int) -> list[tuple[int, float]]:
    """(column, unit in SI) of force x, y, z and, where the log has torques, of torque x, y, z."""
    found: dict[tuple[str, str], tuple[int, float]] = {}
    for column, label in enumerate(labels):
        match = LABEL.fullmatch(label)
        if not match:
            continue
        quantity, axis, unit = match.groups()
        units = FORCE_UNITS if quantity == "Force" else TORQUE_UNITS
        unit = re.sub(r"[-·*.\s]", "", unit or "")
        if unit not in units:
            wanted = f"'{quantity} {axis} (unit)' with one of {', '.join(units)}"
            raise RecordingError(f"label {label!r} has no known unit; write it as {wanted}", file=file, line=line)
        if (quantity, axis) in found:
            raise RecordingError(f"two columns are labelled {quantity} {axis}; correct the labels", file=file, line=line)
        found[quantity, axis] = column, units[unit]
    wanted = [(quantity, axis) for quantity in ("Force", "Torque") for axis in "XYZ"]
    if not any(quantity == "Torque" for quantity, _ in found):
        wanted = wanted[:3]
    missing = [f"{quantity} {axis}" for quantity, axis in wanted if (quantity, axis) not in found]
    if missing:
        shown = ", ".join(labels) or "nothing"
        advice = "export forces and torques with their labels, not gauge voltages"
        raise RecordingError(f"no column is labelled {', '.join(missing)}, only {shown}; {advice}", file=file, line=line)
    return [found[label] for label in wanted]


def _setting(settings: dict[str, str], key: str, decimal: str, file: Path, line: int) -> float:
    try:
        value = float(settings[key].replace(decimal, "."))
    except (KeyError, ValueError):
        raise RecordingError(f"the labels state no {key}, so samples have no time", file=file, line=line, key=key) from None
    if not 0 < value < np.inf:
        raise RecordingError(f"{key} = {value} gives samples no time", file=file, line=line, key=key)
    return value


def write_daqft(file: Path, record: ForceRecord, *, decimal: str = ".") -> None:
    """Write ``record`` in N and N·m as the program does on a PC whose culture has the given ``decimal`` mark ("." or ",").

    Fifteen significant digits, as .NET prints a double, and averaging level 1; the counts are not written.
    """
    separator = ";" if decimal == "," else ","
    labels = [f"Force {axis} (N)" for axis in "XYZ"] + [f"Torque {axis} (N-m)" for axis in "XYZ"]
    labels += [f"Frequency = {record.rate:.15G}".replace(".", decimal), "Averaging Level = 1"]
    labels += [f"F/T Serial Number = {record.serial}", f"Time Started = {record.started}"]
    row = separator.join(['"%.15G"'] * 6) + "\r\n"
    values = np.hstack([record.force, record.torque])
    rows = row * len(values) % tuple(values.ravel().tolist())
    header = separator.join(f'"{label}"' for label in labels) + "\r\n"
    Path(file).write_bytes((header + rows.replace(".", decimal)).encode())
