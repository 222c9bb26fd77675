"""What a log of a force transducer, or its calibration, says of itself."""

from __future__ import annotations

from pathlib import Path

from pipeline.core.errors import PipelineError
from pipeline.formats.force.record import FORCES, TORQUES, ForceLogOptions, require_record
from pipeline.formats.format import Format
from pipeline.tools.inspect.finding import Finding, counted

FAULTS = (
    "repeated_rows",
    "zero_rows",
    "blank_rows",
    "cut_rows",
    "doubled_rows",
    "lost_packets",
    "missing_samples",
    "equal_times",
    "uneven_steps",
    "status_rows",
    "paused_ms",
    "skipped_samples",
)
CLOCKS = ("lost_packets", "missing_samples")  # counted of logs with numbers or times


def log(form: Format, file: Path) -> Finding:
    """A log of a force transducer."""
    finding = Finding.read_by(form, file)
    try:
        stated = form.states(file)
        finding.version, finding.units, finding.facts = stated.version, stated.units, stated.facts
        record = form.read(file, ForceLogOptions())
    except PipelineError as error:
        return finding.refused(error)
    finding.rate, finding.duration = record.rate, float(record.time[-1] - record.time[0])
    if not any(clock in record.counts for clock in CLOCKS):
        finding.facts["times"] = "none in the log: nothing shows a row that it lost"
    finding.gaps = counted(record.counts, *FAULTS)
    facts = {"samples": len(record.time), "serial": record.serial, "started": record.started}
    finding.facts |= {name: value for name, value in facts.items() if value}
    try:
        require_record(record, file)
    except PipelineError as error:
        finding.refused(error)
    return finding


def calibration(form: Format, file: Path) -> Finding:
    """The calibration of a force transducer."""
    finding, stated = Finding.read_by(form, file), form.read(file)
    finding.units = {"force": stated.force_unit, "torque": stated.torque_unit}
    ratings = dict(zip((*FORCES, *TORQUES), stated.full_scale.tolist(), strict=True))
    finding.facts = {"serial": stated.serial, "ratings": ratings}
    return finding
