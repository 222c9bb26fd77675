"""Force records without their bias, as tables: all axes that were logged."""

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Force
from pipeline.formats import force as force_formats
from pipeline.formats.force.calibration import read_calibration
from pipeline.formats.force.record import ForceLogOptions, full_scale, sound_samples
from pipeline.formats.format import Kind, formats_in
from pipeline.recordings.quality import quality_row

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")  # N, N·m
SHARED = ("columns", "separator", "decimal", "force_unit", "torque_unit", "time_unit", "rate")
MIN_SAMPLES = 10  # fewer leave the bias less certain than a third of the noise of one sample
# s; a clock rebuilt from its rate rounds, and one loaded sample would spoil the mean
CLOCK_ROUNDING = 1e-6


def force_rows(raw: Path, name: str, force: Force) -> tuple[pd.DataFrame, list[dict]]:
    """Return the rows of the table ``force`` of the configuration ``name`` from the end of its tare
    on, moments about the option ``point``, and their quality.

    Saturated or frozen samples are left out before the bias is subtracted: a sensor measures the
    whole load. Raises ConfigError for a format that does not exist.
    """
    log, file = force.log, raw / force.configurations[name].file
    calibration = read_calibration(raw / log.calibration) if log.calibration is not None else None
    stated = {key: getattr(log, key) for key in (*SHARED, "counts", "topic")}
    formats = {one.option: one for one in formats_in(force_formats, Kind.FORCE)}
    if log.format not in formats:
        message = f"no format {log.format!r}; there are {', '.join(sorted(formats))}"
        raise ConfigError(message, key="dataset.force.log.format")
    record = formats[log.format].read(file, ForceLogOptions(**stated, calibration=calibration))
    ratings = np.array(log.full_scale) if log.full_scale is not None else full_scale(calibration)
    sound, faults = sound_samples(record, ratings, log.frozen_after, log.max_faulty, file=file)
    wrench = record.force
    if np.isfinite(record.torque).any():
        moment = record.torque - np.cross(force.point, record.force)
        wrench = np.hstack([record.force, moment])
    try:
        time, wrench, biases = remove_bias(record.time[sound], wrench[sound], force.tare)
    except RecordingError as error:
        raise RecordingError(error.message, **error.evidence, file=file) from None
    axes = dict(zip(WRENCH, wrench.T, strict=False))
    quality = [*(record.counts | faults).items()]
    for axis, bias in zip(axes, biases, strict=True):
        quality.append((f"bias_{axis}", bias, "N" if axis[0] == "f" else "N·m"))
    rows = pd.DataFrame({"configuration": name, "t": time} | axes)
    return rows, [quality_row(name, "test", "force transducer", *row) for row in quality]


def remove_bias(
    time: np.ndarray, wrench: np.ndarray, tare_seconds: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time, wrench less bias, and bias, the mean of the first ``tare_seconds``, which are
    dropped, of a record ``time`` (N,) s, ``wrench`` (N, c) N and N·m; with 0 its instrument tared
    it. Raises RecordingError for values that are not finite, an interval too short for a mean, or a
    record that ends with it.
    """
    if not (finite := np.isfinite(wrench).all(axis=1)).all():
        message = "the force record has values that are not finite"
        raise RecordingError(message, step=int(finite.argmin()))
    if tare_seconds == 0:
        return time, wrench, np.zeros(wrench.shape[1])
    unloaded = time - time[0] < tare_seconds - CLOCK_ROUNDING
    count = int(unloaded.sum())
    if count < MIN_SAMPLES or count == len(time):
        message = f"{count} of {len(time)} samples lie in the tare interval of {tare_seconds} s; it"
        raise RecordingError(f"{message} needs at least {MIN_SAMPLES}, and a rest")
    bias = wrench[unloaded].mean(axis=0)
    return time[~unloaded], wrench[~unloaded] - bias, bias
