"""Account of a table of numbers that no instrument's program is known by: a controller's log, or
any other.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.formats.force.record import repeats
from pipeline.formats.format import Format
from pipeline.formats.joints.names import named_like, signals_of
from pipeline.formats.number_sheet import Sheet
from pipeline.formats.units import bare
from pipeline.tools.inspect.finding import Finding, counted
from pipeline.tools.inspect.joints import ask, pair

EVEN = 0.1  # of the median step: how far equal steps may be off
HOLDS = "what the columns hold is not stated: a log of joints, or of forces"
HOLDS_KEYS = (
    "dataset.joint_log.joints, .signals, .time, or dataset.force.log.columns with format table"
)


def numbers(form: Format, file: Path) -> Finding:
    """Return the account of a table of numbers: what can be seen of it, which columns their labels
    and values say are joint angles, and which hold no numbers.
    """
    finding = Finding.read_by(form, file)
    try:
        sheet = form.read(file, key="dataset.joint_log.separator, .decimal (or dataset.force.log)")
        if not sheet.rows:
            finding.stops.append("the header is followed by no whole row of numbers")
            return finding
        sheet.require_cells()
        values = dict(zip(sheet.numeric, sheet.values(sheet.numeric).T, strict=True))
    except PipelineError as error:
        return finding.refused(error)
    if any(line.strip() == "endheader" for line in sheet.header):
        finding.version = "of OpenSim (MOT, STO)"
    finding.facts |= {
        "rows": len(sheet.rows),
        "columns": sheet.width,
        "separator": sheet.separator,
        "decimal": sheet.decimal,
    }
    gaps = sheet.counts | repeats(np.column_stack([*values.values()]))
    finding.gaps = counted(gaps, "blank_rows", "cut_rows", "repeated_rows", "zero_rows")
    if sheet.left_out:
        finding.facts["columns_without_numbers"] = sheet.left_out
    _clock(finding, values)
    if sheet.labels:
        _labelled(finding, sheet, values)
    if sheet.width == 1:
        finding.open.append(
            (
                "one number a line is one column: it is one joint's, read with signals "
                "{actual: [0], …} and time null; else write the numbers of one time in one line",
                "dataset.joint_log.signals",
            )
        )
    elif {"actual", "target"} - {*finding.facts.get("signals", ())}:
        finding.open.append((HOLDS, HOLDS_KEYS))
    return finding


def _clock(finding: Finding, values: dict[int, np.ndarray]) -> None:
    """Add which columns increase, and the steps of the first one where it does."""
    clock = [n for n, held in values.items() if len(held) > 2 and (np.diff(held) > 0).all()]
    finding.facts["increasing_columns"] = clock
    if clock[:1] == [0]:
        steps = np.diff(values[0])
        median = float(np.median(steps))
        others = [np.abs(held).max() for column, held in values.items() if column]
        finding.facts["step_of_column_0"] = round(median, 9)
        finding.facts["greatest"] = float(max(others, default=0.0))
        uneven = np.abs(steps - median) > EVEN * median
        finding.facts["uneven_steps_of_column_0"] = int(uneven.sum())


def _labelled(finding: Finding, sheet: Sheet, values: dict[int, np.ndarray]) -> None:
    """Add what labels and values say of the columns."""
    labels, clock = sheet.labels, finding.facts["increasing_columns"]
    finding.facts["labels"] = labels
    units = {bare(labels[n]): sheet.unit(n) for n in range(len(labels))}
    finding.units = {label: unit for label, unit in units.items() if unit}
    timed = [n for n in clock if named_like("time", [labels[n]])] or [n for n in clock if n == 0]
    if timed:
        finding.facts["time"] = labels[timed[0]]
    columns = {labels[n]: held for n, held in values.items()}
    if len(columns) < len(values):
        return  # two columns have one label: numbers name them
    time = values[timed[0]] if timed else None
    signals, guesses = signals_of([*columns], time, columns.__getitem__)
    certain = {name: held for name, held in signals.items() if name not in guesses}
    if certain:
        finding.facts["signals"] = certain
    if guesses:
        named = ", ".join(f"{name}: [{', '.join(held)}]" for name, held in signals.items())
        ask(finding, "signals", f"{{{named}}}", f"no label says it: {'; '.join(guesses.values())}")
    if {"actual", "target"} <= {*signals} and timed:
        angles = [np.column_stack([columns[n] for n in signals[s]]) for s in ("actual", "target")]
        stated = sheet.unit(labels.index(signals["actual"][0])) or sheet.angle_unit
        pair(finding, time, *angles, signals["actual"], stated, sheet.unit(timed[0]))
