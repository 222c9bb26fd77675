"""Force records without their bias, as tables."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline import schema
from pipeline.instruments.ati import read_daqft
from pipeline.recordings.quality import quality_row
from pipeline.wrench.tare import remove_bias


def force_rows(raw: Path, name: str, force: schema.Force) -> tuple[pd.DataFrame, list[dict]]:
    """Rows of the table ``force`` of the configuration ``name``, from the end of its tare on; and their quality."""
    record = read_daqft(raw / force.configurations[name].file)
    tared = remove_bias(record.time, record.force, force.tare)
    rows = pd.DataFrame({"configuration": name, "t": tared.time, "fx": tared.force[:, 0], "fy": tared.force[:, 1]})
    quality = [quality_row(name, "test", "force transducer", key, value) for key, value in record.counts.items()]
    quality += [quality_row(name, "test", "force transducer", f"bias_f{axis}", tared.bias[i], "N") for i, axis in enumerate("xyz")]
    return rows, quality
