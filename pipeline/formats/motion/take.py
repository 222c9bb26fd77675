"""A motion-capture take, whatever file it comes from: markers and rigid bodies over numbered
frames, in m and s.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError

UNITS_PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
SPELLINGS = {
    "m": ("m", "meters", "metres"),
    "cm": ("cm", "centimeters", "centimetres"),
    "mm": ("mm", "millimeters", "millimetres"),
}
FARTHEST = 100.0  # m from the origin, beyond which nothing is captured
# what capture programs call a marker of no asset
STRAY = re.compile(r"(Marker-|Unlabeled[: ]?|\*)\d+|")
WHOLE = re.compile(r"[0-9]{1,18}")  # a count or an ID as text, of a size that can be meant
# Time is printed with at least two decimals: two rounded times differ from the frames' by at most
# this, s
TIME_ROUNDING = 0.0101
# share by which a stated rate may be off that of the printed times: far above any clock's drift
RATE_TOLERANCE = 0.01
UNIT_TOLERANCE = 0.01  # of a quaternion's length, far above what printed digits take from it
TELLING = 20  # printed times, fewer are too few to contradict a stated rate
Place = Callable[..., dict[str, object]]  # where a sample, and its axis, stands in a file


@dataclass(frozen=True)
class RigidBody:
    """Pose of a rigid body's pivot in the world frame: position (N, 3) in m, quaternion (N, 4) as
    x, y, z, w; NaN where it was lost.

    q and −q are one rotation: signs are as recorded and flip between frames.
    """

    position: np.ndarray
    quaternion: np.ndarray


@dataclass(frozen=True)
class MotionTake:
    """One take of N frames in the world frame of the capture (right-handed; of Motive, y up unless
    exported otherwise).
    """

    name: str
    version: str  # of the format
    rate: float  # Hz, of the frame numbers
    frame: np.ndarray  # (N,) int64, increasing; gaps are frames that were not exported
    time: np.ndarray  # (N,) s since the first exported frame, from frame numbers and rate
    markers: dict[str, np.ndarray]  # name: (N, 3) m, NaN where occluded
    bodies: dict[str, RigidBody]
    # what was skipped, lost, repaired or contradicted; see the reader of the format
    counts: dict[str, int]
    unit: str = "m"  # of lengths in the file
    printed_rate: float | None = None  # Hz, by the times that the file prints, where there are any


def settle_unit(stated: str, option: str | None, file: Path, *, key: str) -> str:
    """The unit of a file's lengths (m, cm or mm): what the file states under ``key``, else the
    ``option``.

    Raises RecordingError where the file states another unit, where neither says it, and where they
    contradict each other.
    """
    unit = next(
        (unit for unit, names in SPELLINGS.items() if stated.strip().lower() in names), None
    )
    if stated.strip() and unit is None:
        raise RecordingError(
            f"{key} are {stated!r}, not metres, centimetres or millimetres; export in one of these",
            file=file,
            key=key,
        )
    if unit and option and unit != option:
        raise RecordingError(
            f"the file's lengths are in {unit}, not in {option}; mend the option",
            file=file,
            key="dataset.mocap.unit",
        )
    if not unit and not option:
        raise RecordingError(
            "the file does not say the unit of its lengths: set it to m, cm or mm",
            file=file,
            key="dataset.mocap.unit",
        )
    return unit or option


def frame_numbers(values: np.ndarray, lines: list[int], file: Path) -> np.ndarray:
    """(N,) int64 of the frame numbers read at ``lines``; RecordingError where one is missing, not
    whole or not above the one before.
    """
    whole = np.isfinite(values) & (values == np.round(values)) & (np.abs(values) < 2**53)
    if not whole.all():
        raise RecordingError(
            "the frame number is missing or not whole", file=file, line=lines[int(np.argmin(whole))]
        )
    frame = values.astype(np.int64)
    if (np.diff(frame) <= 0).any():
        raise RecordingError(
            "the frame number does not increase",
            file=file,
            line=lines[int(np.argmax(np.diff(frame) <= 0)) + 1],
        )
    return frame


def rate_from_times(frame: np.ndarray, printed: np.ndarray) -> float | None:
    """Frames a second of a file that states no rate: cameras run at whole numbers of them, and
    printed times are rounded.

    The whole number nearest to the mean rate, unless it puts a frame farther from its printed time
    than rounding to the decimals that are printed can, or half a frame: then the mean rate. None
    where the times do not increase over the take.
    """
    frame, time = (values[np.isfinite(printed)] for values in (frame, printed))
    if len(time) < 2 or time[-1] <= time[0]:
        return None
    mean = (frame[-1] - frame[0]) / (time[-1] - time[0])
    off = np.abs((frame - frame[0]) / max(np.round(mean), 1.0) - (time - time[0]))
    rounded = (
        TIME_ROUNDING if np.allclose(time * 100, np.round(time * 100), rtol=0, atol=1e-6) else 0.0
    )
    return float(np.round(mean)) if off.max() < max(0.5 / mean, rounded) else float(mean)


def keeps_time(frame: np.ndarray, printed: np.ndarray, rate: float) -> bool:
    """Whether the ``printed`` times (N,) s of the frames pass as ``rate`` (1/s) has it, over a
    quarter of the take at a time.

    Times that jump now and then do, as do rounded ones: the median decides. True of too few times
    to tell.
    """
    frame, time = (values[np.isfinite(printed)] for values in (frame, printed))
    if len(time) < TELLING:
        return True
    lag = len(time) // 4
    passed, expected = time[lag:] - time[:-lag], (frame[lag:] - frame[:-lag]) / rate
    return bool(
        np.median(np.abs(passed - expected) - TIME_ROUNDING - RATE_TOLERANCE * expected) <= 0
    )


def clock_counts(frame: np.ndarray, time: np.ndarray, printed: np.ndarray | None) -> dict[str, int]:
    """``found_frames``, ``gaps`` in their numbers, ``skipped_frames`` there, and
    ``time_mismatches``: printed times not of their frame.
    """
    step = np.diff(frame)
    off = np.zeros(0) if printed is None else np.abs(printed - printed[0] - time)
    return {
        "found_frames": len(frame),
        "gaps": int(np.sum(step > 1)),
        "skipped_frames": int(np.sum(step - 1)),
        "time_mismatches": int(np.sum(off > TIME_ROUNDING)),
    }


def checked_position(
    position: np.ndarray, name: str, unit: str, place: Place, counts: dict[str, int]
) -> np.ndarray:
    """Return (N, 3) in m the ``position`` (N, 3) of ``name`` in a file in ``unit``: lost samples
    as NaN in all coordinates, with ``zero_samples`` and ``partial_samples`` among them counted.

    Exact zeros in all coordinates are a lost sample: a marker is never within half a micrometre of
    the origin. RecordingError at ``place(k)`` or ``place(k, axis)`` where one lies beyond FARTHEST,
    or one coordinate is missing wherever the others are there.
    """
    position = position / UNITS_PER_METRE[unit]
    with np.errstate(invalid="ignore"):
        far = np.abs(position) > FARTHEST
    if far.any():
        k, axis = (int(index) for index in np.argwhere(far)[0])
        raise RecordingError(
            f"{name} is at {position[k, axis]:.6g} m, farther than any camera sees "
            f"({FARTHEST:g} m): are lengths in {unit}, and is the decimal mark a point?",
            **place(k, axis),
        )
    missing = ~np.isfinite(position)
    for axis in range(3):
        sighted = ~missing[:, [other for other in range(3) if other != axis]].all(axis=1)
        if sighted.any() and missing[:, axis].all():
            raise RecordingError(
                f"{name} has no {'XYZ'[axis]} in any row, but other coordinates: a column is "
                "missing or shifted; export the take again",
                **place(int(sighted.argmax()), axis),
            )
    zero, lost = (position == 0).all(axis=-1), missing.any(axis=-1)
    counts["zero_samples"] += int(zero.sum())
    counts["partial_samples"] += int(lost.sum() - missing.all(axis=-1).sum())
    position[zero | lost] = np.nan
    return position


def checked_rotation(
    quaternion: np.ndarray, name: str, place: Place, counts: dict[str, int]
) -> np.ndarray:
    """Return (N, 4) the ``quaternion`` of the body ``name``, NaN where it is lost; zeros in all
    components are, and are counted among ``zero_samples``. RecordingError at ``place(k)`` where one
    has another length than 1.
    """
    zero = (quaternion == 0).all(axis=-1)
    counts["zero_samples"] += int(zero.sum())
    quaternion = np.where((zero | np.isnan(quaternion).any(axis=-1))[:, None], np.nan, quaternion)
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternion, axis=-1)
    if (off := np.abs(length - 1) > UNIT_TOLERANCE).any():
        k = int(off.argmax())
        raise RecordingError(
            f"the rotation of {name} is of the length {length[k]:.6g}, where a unit quaternion "
            "should stand: a number is damaged, or columns are shifted",
            **place(k),
        )
    return quaternion


def sample_counts(
    markers: dict[str, np.ndarray], bodies: dict[str, RigidBody], frames: int
) -> dict[str, int]:
    """``marker_samples``, the ``missing_samples`` among them, and the ``missing_poses`` of
    bodies.
    """
    return {
        "marker_samples": len(markers) * frames,
        "missing_samples": int(
            sum(np.isnan(position[:, 0]).sum() for position in markers.values())
        ),
        "missing_poses": int(
            sum(
                np.isnan(body.position + body.quaternion[:, :3]).any(axis=-1).sum()
                for body in bodies.values()
            )
        ),
    }
