"""Tables of force records: forces and moments of all logged axes without bias."""

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Force
from pipeline.formats import force as force_formats
from pipeline.formats.force.calibration import read_calibration
from pipeline.formats.force.record import ForceLogOptions, sound_samples
from pipeline.formats.format import Kind, formats_in
from pipeline.recordings.quality import quality_rows

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")  # N, N·m
SHARED = (
    "columns",
    "separator",
    "decimal",
    "force_unit",
    "torque_unit",
    "time_unit",
    "rate",
    "counts",
    "topic",
)
MIN_SAMPLES = 10  # least number of tare samples: the bias error is a third of the noise
CLOCK_ROUNDING = 1e-6  # s, margin that keeps loaded samples out of the tare interval


def force_rows(raw: Path, name: str, force: Force) -> tuple[pd.DataFrame, list[dict]]:
    """Return the rows of the table ``force`` of the configuration ``name`` after the tare interval,
    in N and in N·m about the option ``point``, and the quality rows.

    Saturated or frozen samples are left out before the bias is subtracted, since ratings apply to
    the whole load. Raises ConfigError for an unknown format, RecordingError as :func:`remove_bias`.
    """
    log = force.log
    file = raw / force.configurations[name].file
    calibration = None
    ratings = None
    if log.calibration is not None:
        calibration = read_calibration(raw / log.calibration)
        ratings = calibration.full_scale
    if log.full_scale is not None:
        ratings = np.array(log.full_scale)
    formats = {}
    for force_format in formats_in(force_formats, Kind.FORCE):
        formats[force_format.option] = force_format
    if log.format not in formats:
        names = ", ".join(sorted(formats))
        message = f"unknown format {log.format!r}; set one of {names}"
        raise ConfigError(message, key="dataset.force.log.format")
    stated = {key: getattr(log, key) for key in SHARED}
    options = ForceLogOptions(**stated, calibration=calibration)
    record = formats[log.format].read(file, options)
    sound, faults = sound_samples(
        record,
        ratings,
        log.frozen_after,
        log.max_faulty,
        file=file,
    )
    wrench = record.force
    if np.isfinite(record.torque).any():
        moment = record.torque - np.cross(force.point, record.force)
        wrench = np.hstack([record.force, moment])
    time, wrench, biases = remove_bias(
        record.time[sound],
        wrench[sound],
        force.tare,
        file=file,
    )
    axes = dict(zip(WRENCH, wrench.T, strict=False))
    notes = [*(record.counts | faults).items()]
    for axis, bias in zip(axes, biases, strict=True):
        unit = "N" if axis.startswith("f") else "N·m"
        notes.append((f"bias_{axis}", bias, unit))
    rows = pd.DataFrame({"configuration": name, "t": time} | axes)
    return rows, quality_rows(name, "test", "force transducer", notes)


def remove_bias(
    time: np.ndarray,
    wrench: np.ndarray,
    tare_seconds: float,
    **evidence: object,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the time and the wrench minus bias after the tare interval, and the bias. The bias is
    the mean of ``wrench`` (N, c) in N and N·m over the first ``tare_seconds`` of ``time`` (N,) s;
    with 0 (tared by the instrument) the bias is 0.

    Raises RecordingError for values that are not finite, a tare interval with fewer than
    MIN_SAMPLES, and a record without samples after the interval.
    """
    finite = np.isfinite(wrench).all(axis=1)
    if not finite.all():
        message = "the force record has values that are not finite"
        raise RecordingError(message, **evidence, step=int(finite.argmin()))
    if tare_seconds == 0:
        return time, wrench, np.zeros(wrench.shape[1])
    unloaded = time - time[0] < tare_seconds - CLOCK_ROUNDING
    count = int(unloaded.sum())
    if count < MIN_SAMPLES or count == len(time):
        raise RecordingError(
            f"{count} of {len(time)} samples lie in the tare interval of {tare_seconds} s; "
            f"at least {MIN_SAMPLES} are required, and further samples after the interval",
            **evidence,
        )
    bias = wrench[unloaded].mean(axis=0)
    return time[~unloaded], wrench[~unloaded] - bias, bias
