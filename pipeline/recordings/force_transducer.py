"""Force records without their bias, as tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import schema
from pipeline.instruments.ati import read_daqft
from pipeline.instruments.ati_calibration import read_calibration
from pipeline.instruments.ati_netft import read_netft
from pipeline.instruments.force_bag import read_force_bag
from pipeline.instruments.force_faults import sound_samples
from pipeline.instruments.force_record import LogOptions, full_scale
from pipeline.instruments.force_table import read_force_table
from pipeline.recordings.quality import quality_row
from pipeline.wrench.tare import remove_bias

READERS = {"daqft": read_daqft, "netft": read_netft, "bag": read_force_bag, "table": read_force_table}


def force_rows(raw: Path, name: str, force: schema.Force) -> tuple[pd.DataFrame, list[dict]]:
    """Rows of the table ``force`` of the configuration ``name``, from the end of its tare on; and their quality.

    Samples that are saturated or frozen are left out, and looked for before the bias is taken out: a sensor measures the whole load.
    """
    log, file = force.log, raw / force.configurations[name].file
    calibration = read_calibration(raw / log.calibration) if log.calibration is not None else None
    options = LogOptions(
        columns=log.columns, separator=log.separator, decimal=log.decimal, force_unit=log.force_unit, torque_unit=log.torque_unit,
        time_unit=log.time_unit, rate=log.rate, counts=log.counts, calibration=calibration, topic=log.topic,
    )  # fmt: skip
    record = READERS[log.format](file, options)
    ratings = np.array(log.full_scale) if log.full_scale is not None else full_scale(calibration)
    sound, faults = sound_samples(record, ratings, log.frozen_after, log.max_faulty, file=file)
    counts = record.counts | faults
    tared = remove_bias(record.time[sound], record.force[sound], force.tare)
    rows = pd.DataFrame({"configuration": name, "t": tared.time, "fx": tared.force[:, 0], "fy": tared.force[:, 1]})
    quality = [quality_row(name, "test", "force transducer", key, value) for key, value in counts.items()]
    quality += [quality_row(name, "test", "force transducer", f"bias_f{axis}", tared.bias[i], "N") for i, axis in enumerate("xyz")]
    return rows, quality
