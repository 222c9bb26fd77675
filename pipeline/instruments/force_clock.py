"""What the times of a force record tell: rows written twice, jitter, gaps."""

from __future__ import annotations

import numpy as np

from pipeline.errors import RecordingError

JITTER = 0.1  # of the median step


def read_clock(time: np.ndarray, values: np.ndarray, places: list[int], *, place: str, file: object) -> tuple[np.ndarray, dict[str, int]]:
    """Which of N samples to keep (N,), and what their ``time`` (N,) in s shows of ``values`` (N, axes).

    Counts: ``doubled_rows`` (the same sample at the same time, not kept), ``equal_times`` (another sample at the same time, kept),
    ``uneven_steps`` (off the median by more than a tenth of it: jitter) and ``missing_samples`` (that would fit into the longer steps).
    Raises RecordingError, with the number in ``places`` (N) of the ``place`` (line, sample) there, for a time that goes back, and for one
    that most samples share with the one before.
    """
    steps = np.diff(time)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0)) + 1
        raise RecordingError(f"the time goes back to {time[row]:.9g} s", file=file, **{place: places[row]})
    doubled = (steps == 0) & (values[1:] == values[:-1]).all(axis=1)
    keep = np.append(True, ~doubled)
    steps = np.diff(time[keep])
    median = float(np.median(steps)) if len(steps) else 0.0
    if len(steps) and median == 0:
        raise RecordingError("most samples share their time with the one before: no clock", file=file, **{place: places[0]})
    return keep, {
        "doubled_rows": int(doubled.sum()),
        "equal_times": int(np.sum(steps == 0)),
        "uneven_steps": int(np.sum(np.abs(steps - median) > JITTER * median)),
        "missing_samples": int(np.sum(np.rint(steps[steps > 1.5 * median] / median) - 1)),
    }


def rate_of(time: np.ndarray) -> float:
    """Samples a second by the median step of ``time`` (N,) in s; NaN of a single sample."""
    return float(1 / np.median(np.diff(time))) if len(time) > 1 else float("nan")
