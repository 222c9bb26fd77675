"""The transducer's bias, taken out of the unloaded interval at the start of its record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import RecordingError

MIN_SAMPLES = 10  # fewer leave the bias less certain than a third of the noise of one sample

# s; a clock rebuilt from its rate rounds, and one loaded sample would spoil the mean
CLOCK_ROUNDING = 1e-6


@dataclass(frozen=True)
class TaredWrench:
    """A force record without its bias, from the end of the tare interval on."""

    time: np.ndarray  # (N,) s, on the clock of the record
    wrench: np.ndarray  # (N, c) N, N·m
    bias: np.ndarray  # (c,) what was subtracted
    noise: np.ndarray  # (c,) standard deviation within the tare interval
    tare_samples: int


def remove_bias(time: np.ndarray, wrench: np.ndarray, tare_seconds: float) -> TaredWrench:
    """Subtract the mean of the first ``tare_seconds`` of a record ``time`` (N,) in s, ``wrench``
    (N, c) in N and N·m, and drop that interval.

    With ``tare_seconds`` = 0 the record counts as tared by its instrument: nothing is subtracted or
    dropped, the noise is 0. Raises RecordingError for values that are not finite, a tare interval
    too short for a mean, or a record that ends with it.
    """
    if not np.isfinite(wrench).all():
        raise RecordingError(
            "the force record has values that are not finite",
            step=int(np.argwhere(~np.isfinite(wrench))[0, 0]),
        )
    if tare_seconds == 0:
        return TaredWrench(time, wrench, np.zeros(wrench.shape[1]), np.zeros(wrench.shape[1]), 0)
    unloaded = time - time[0] < tare_seconds - CLOCK_ROUNDING
    count = int(unloaded.sum())
    if count < MIN_SAMPLES or count == len(time):
        raise RecordingError(
            f"{count} of {len(time)} samples lie in the tare interval of {tare_seconds} s; it "
            f"needs at least {MIN_SAMPLES}, and a rest"
        )
    bias = wrench[unloaded].mean(axis=0)
    return TaredWrench(
        time[~unloaded], wrench[~unloaded] - bias, bias, wrench[unloaded].std(axis=0, ddof=1), count
    )
