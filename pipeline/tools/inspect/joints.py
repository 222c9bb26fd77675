"""What a controller's joint log of a known format says of itself."""

from __future__ import annotations

from pathlib import Path

from pipeline.core.errors import PipelineError
from pipeline.formats.format import Format
from pipeline.formats.joints.log import LogOptions
from pipeline.tools.inspect.finding import Finding, counted


def log(form: Format, file: Path) -> Finding:
    """A log of the joints, with the signals that it holds."""
    finding, stated = Finding.read_by(form, file), form.states(file)
    finding.version, finding.units, finding.facts = stated.version, stated.units, stated.facts
    try:
        record = form.read(file, LogOptions())
    except PipelineError as error:
        return finding.refused(error)
    finding.duration = float(record.time[-1] - record.time[0])
    if finding.duration:
        finding.rate = round((len(record.time) - 1) / finding.duration, 3)
    finding.gaps = counted(record.counts, "cut_rows", "blank_rows", "doubled_rows")
    finding.facts |= {"samples": len(record.time), "signals": list(record.signals)}
    finding.facts |= {"joints": max(values.shape[1] for values in record.signals.values())}
    return finding
