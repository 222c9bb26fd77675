"""Force records without their bias, as tables: all axes that were logged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.errors import ConfigError
from pipeline.core.options.instruments import Force
from pipeline.formats import force as force_formats
from pipeline.formats.force.calibration import read_calibration
from pipeline.formats.force.record import ForceLogOptions, full_scale, sound_samples
from pipeline.formats.format import Format, Kind, formats_in
from pipeline.recordings.quality import quality_row
from pipeline.recordings.tare import remove_bias

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")  # N, N·m


def force_rows(raw: Path, name: str, force: Force) -> tuple[pd.DataFrame, list[dict]]:
    """Rows of the table ``force`` of the configuration ``name``, from the end of its tare on; and
    their quality. Moments, where torques were logged, are about the option ``point``.

    Samples that are saturated or frozen are left out, and looked for before the bias is taken out:
    a sensor measures the whole load. Raises ConfigError for a format that does not exist.
    """
    log, file = force.log, raw / force.configurations[name].file
    calibration = read_calibration(raw / log.calibration) if log.calibration is not None else None
    options = ForceLogOptions(
        columns=log.columns,
        separator=log.separator,
        decimal=log.decimal,
        force_unit=log.force_unit,
        torque_unit=log.torque_unit,
        time_unit=log.time_unit,
        rate=log.rate,
        counts=log.counts,
        calibration=calibration,
        topic=log.topic,
    )
    record = _format(log.format).read(file, options)
    ratings = np.array(log.full_scale) if log.full_scale is not None else full_scale(calibration)
    sound, faults = sound_samples(record, ratings, log.frozen_after, log.max_faulty, file=file)
    counts = record.counts | faults
    wrench = record.force
    if np.isfinite(record.torque).any():
        moment = record.torque - np.cross(force.point, record.force)
        wrench = np.hstack([record.force, moment])
    tared = remove_bias(record.time[sound], wrench[sound], force.tare)
    axes = dict(zip(WRENCH, tared.wrench.T, strict=False))
    rows = pd.DataFrame({"configuration": name, "t": tared.time} | axes)
    quality = [
        quality_row(name, "test", "force transducer", key, value) for key, value in counts.items()
    ]
    quality += [
        quality_row(
            name, "test", "force transducer", f"bias_{axis}", bias, "N" if axis[0] == "f" else "N·m"
        )
        for axis, bias in zip(axes, tared.bias, strict=True)
    ]
    return rows, quality


def _format(option: str) -> Format:
    """The format of force logs that the ``option`` names."""
    formats = {one.option: one for one in formats_in(force_formats, Kind.FORCE)}
    if option not in formats:
        raise ConfigError(
            f"no format {option!r}; there are {', '.join(sorted(formats))}",
            key="dataset.force.log.format",
        )
    return formats[option]
