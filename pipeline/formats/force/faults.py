"""Samples that a force sensor did not measure: a line of settings above none, beyond its full
scale, or the same ones over and over.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import ForceRecord

FEWEST = 10  # samples of a record; what holds fewer may be settings that look like numbers


def require_record(record: ForceRecord, file: object) -> None:
    """RecordingError where ``record`` holds too few samples to be one."""
    if len(record.time) < FEWEST:
        first = ", ".join(f"{force:g}" for force in record.force[0])
        raise RecordingError(
            f"{len(record.time)} sample(s) are no record, where {FEWEST} is the fewest; the first "
            f"is {first} N, which may be a line of settings below a header: record again",
            file=file,
        )


def saturated(record: ForceRecord, full_scale: np.ndarray) -> np.ndarray:
    """(N,) whether any axis of a sample is at or beyond ``full_scale`` (3,) N or (6,) N and N·m;
    torques that were not logged are not.
    """
    values = np.hstack([record.force, record.torque])[:, : len(full_scale)]
    return np.any(np.abs(values) >= full_scale, axis=1)


def frozen(record: ForceRecord, longest: float) -> np.ndarray:
    """(N,) whether a sample is one of identical ones that last longer than ``longest`` (s).

    Noise keeps a working sensor from repeating all its axes for long; a program that reads faster
    than the sensor samples repeats a few.
    """
    values = np.hstack([record.force, np.nan_to_num(record.torque)])
    starts = np.flatnonzero(np.append(True, (values[1:] != values[:-1]).any(axis=1)))
    ends = np.append(starts[1:], len(values))
    lasting = record.time[ends - 1] - record.time[starts]
    return np.repeat(lasting > longest, ends - starts)


def sound_samples(
    record: ForceRecord,
    full_scale: np.ndarray | None,
    longest: float,
    share: float,
    *,
    file: object,
) -> tuple[np.ndarray, dict[str, int]]:
    """(N,) whether a sample was measured, and how many are saturated (where ``full_scale`` is
    known) and frozen, if any.

    Raises RecordingError where a fault is in more than the given ``share`` of the samples, and for
    what is no record.
    """
    require_record(record, file)
    faulty = {"frozen_samples": frozen(record, longest)}
    if full_scale is not None:
        faulty["saturated_samples"] = saturated(record, full_scale)
    for name, samples in faulty.items():
        if samples.mean() > share:
            word, key = (
                name.removesuffix("_samples"),
                "frozen_after" if name.startswith("frozen") else "full_scale",
            )
            message = (
                f"{samples.sum()} of {len(samples)} samples are {word}, the first at "
                f"{record.time[samples][0]:.6g} s"
            )
            raise RecordingError(
                f"{message}; a share of {share:g} may be", file=file, key=f"dataset.force.log.{key}"
            )
    return ~np.any(list(faulty.values()), axis=0), {
        name: int(samples.sum()) for name, samples in faulty.items() if samples.any()
    }
