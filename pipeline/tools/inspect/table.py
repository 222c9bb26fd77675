"""What a table of numbers that no instrument's program is known by says of itself: a controller's
log, or any other.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.formats.force.record import repeats
from pipeline.formats.format import Format
from pipeline.formats.joints.names import signals_of
from pipeline.formats.labels import bare, unit_of
from pipeline.tools.inspect.finding import Finding, counted

EVEN = 0.1  # of the median step: how far equal steps may be off


def numbers(form: Format, file: Path) -> Finding:
    """A table of numbers; which column is what stands in options, so that only what can be seen is
    said of them.
    """
    finding = Finding.read_by(form, file)
    try:
        sheet = form.read(file, key="dataset.joint_log.separator, .decimal (or dataset.force.log)")
        if not sheet.rows:
            finding.stops.append("the header is followed by no whole row of numbers")
            return finding
        sheet.require_cells()
        # spreadsheets pad rows with empty cells
        width = len(sheet.rows[0].rstrip(sheet.separator + " ").split(sheet.separator))
        labels = next(
            (
                row
                for index in range(len(sheet.header))
                if len(row := sheet.header_cells(index)[:width]) == width
            ),
            [],
        )
        values = sheet.values(list(range(width)))
    except PipelineError as error:
        return finding.refused(error)
    finding.facts |= {
        "rows": len(values),
        "columns": width,
        "separator": sheet.separator,
        "decimal": sheet.decimal,
    }
    gaps = sheet.counts | repeats(values)
    finding.gaps = counted(gaps, "blank_rows", "cut_rows", "repeated_rows", "zero_rows")
    if labels:
        finding.facts["labels"] = labels
        if signals := signals_of(labels):
            finding.facts["signals"] = signals
        finding.units = {bare(label): unit for label in labels if (unit := unit_of(label))}
    clock = [
        column
        for column in range(width)
        if len(values) > 2 and (np.diff(values[:, column]) > 0).all()
    ]
    finding.facts["increasing_columns"] = clock
    if clock[:1] == [0]:
        steps = np.diff(values[:, 0])
        median = float(np.median(steps))
        finding.facts["step_of_column_0"] = round(median, 9)
        finding.facts["greatest"] = float(np.abs(values[:, 1:]).max(initial=0.0))
        finding.facts["uneven_steps_of_column_0"] = int(
            np.sum(np.abs(steps - median) > EVEN * median)
        )
    what = "what the columns hold is not stated: a log of joints, or of forces"
    finding.open.append(
        (
            what,
            "dataset.joint_log.joints, .signals, .time, or dataset.force.log.columns with format "
            "table",
        )
    )
    return finding
