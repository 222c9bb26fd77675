"""What a log of a force transducer, or its calibration, says of itself."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import PipelineError
from pipeline.inspection.finding import Finding, counted
from pipeline.instruments.ati import read_daqft
from pipeline.instruments.ati_calibration import read_calibration
from pipeline.instruments.ati_netft import read_netft
from pipeline.instruments.delimited import read_text
from pipeline.instruments.force_record import FORCES, TORQUES, ForceRecord, axis_of
from pipeline.instruments.number_sheet import read_sheet, unit_of

FAULTS = (
    "repeated_rows", "zero_rows", "blank_rows", "cut_rows", "doubled_rows", "lost_packets", "missing_samples", "equal_times",
    "uneven_steps", "status_rows", "paused_ms", "skipped_samples",
)  # fmt: skip
CLOCKS = ("lost_packets", "missing_samples")  # counted of logs with numbers or times
OPTION = "dataset.force.log"


def daqft(file: Path) -> Finding:
    """A log of ATI's DAQ F/T, in either locale."""
    finding = Finding(file, "ATI DAQ F/T log")
    try:
        sheet = read_sheet(file, key=OPTION)
        names = {";": "semicolons", ",": "commas", "\t": "tabs"}
        finding.facts |= {"separator": sheet.separator, "decimal": sheet.decimal}
        finding.version = f"{names.get(sheet.separator, 'blanks')} and decimal {'comma' if sheet.decimal == ',' else 'point'}"
        return _recorded(finding, read_daqft(file), [sheet.header_cells(index) for index in range(len(sheet.header))])
    except PipelineError as error:
        return finding.refused(error)


def netft(file: Path) -> Finding:
    """A log of ATI's Net F/T."""
    finding = Finding(file, "ATI Net F/T log")
    try:
        head = [line.strip('" ').partition(":") for line in read_text(file).lines[:12]]
        units = {key.split()[0].lower(): value.strip(' "') for key, _, value in head if key in ("Force Units", "Torque Units")}
        finding.units = units
        return _recorded(finding, read_netft(file), [])
    except PipelineError as error:
        return finding.refused(error)


def calibration(file: Path) -> Finding:
    """The calibration of an ATI transducer."""
    found = read_calibration(file)
    ratings = dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), found.full_scale.tolist(), strict=True))
    facts = {"serial": found.serial, "ratings": ratings}
    return Finding(file, "ATI calibration", units={"force": found.force_unit, "torque": found.torque_unit}, facts=facts)


def _recorded(finding: Finding, record: ForceRecord, header: list[list[str]]) -> Finding:
    for quantity, axes in (("force", FORCES), ("torque", TORQUES)):
        # behind the labels, or in the row below them
        places = [(row, column) for row, cells in enumerate(header) for column, cell in enumerate(cells) if axis_of(cell) in axes]
        below = [header[row + 1][column] for row, column in places if row + 1 < len(header) and column < len(header[row + 1])]
        stated = {unit for row, column in places if (unit := unit_of(header[row][column]))} or set(below) - {""}
        if len(stated) == 1:
            finding.units[quantity] = stated.pop()
    finding.rate, finding.duration = record.rate, float(record.time[-1] - record.time[0])
    if not any(clock in record.counts for clock in CLOCKS):
        finding.facts["times"] = "none in the log: nothing shows a row that it lost"
    finding.gaps = counted(record.counts, *FAULTS)
    facts = {"samples": len(record.time), "serial": record.serial, "started": record.started}
    finding.facts |= {name: value for name, value in facts.items() if value}
    return finding
