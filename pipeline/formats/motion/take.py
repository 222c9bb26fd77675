"""A motion-capture take, whatever file it comes from: markers and rigid bodies over numbered
frames, in m and s.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.units import spelled

UNITS_PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
FARTHEST = 100.0  # m from the origin, beyond which nothing is captured
# names that capture programs give to a marker of no asset
STRAY = re.compile(r"(Marker-|Unlabeled[: ]?|\*)\d+|")
WHOLE = re.compile(r"[0-9]{1,18}")  # a count or an ID as text, of a size that can be meant
# s by which two printed times, of two decimals or more, differ from the frames' at most
TIME_ROUNDING = 0.0101
# share by which a stated rate may be off that of the printed times: far above any clock's drift
RATE_TOLERANCE = 0.01
UNIT_TOLERANCE = 0.01  # of a quaternion's length, far above what printed digits take from it
TELLING = 20  # printed times, fewer are too few to contradict a stated rate
NO_ASSET = "the take holds no marker and no rigid body"
FROM_TIMES = "the printed times: the file states none"  # its rate
Place = Callable[..., dict[str, object]]  # evidence of a sample, and of its axis, in a file


@dataclass(frozen=True)
class RigidBody:
    """Pose of a rigid body's pivot in the world frame, NaN where it was lost."""

    position: np.ndarray  # (N, 3) m
    quaternion: np.ndarray  # (N, 4) x, y, z, w; signs are as recorded and flip between frames


@dataclass(frozen=True)
class MotionTake:
    """One take of N frames in the world frame of the capture (right-handed; of Motive, y up)."""

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
    rate_from: str = ""  # where the file states no rate


def settle_unit(stated: str, option: str | None, file: Path, *, key: str) -> str:
    """Return the unit of a file's lengths (m, cm or mm): ``stated`` under ``key``, else the
    ``option``; RecordingError for another unit, none, and a contradiction.
    """
    unit, message = spelled(stated) or option, ""
    if unit not in UNITS_PER_METRE and stated.strip():
        message = f"{key} are {stated!r}, not metres, centimetres or millimetres; export in "
        raise RecordingError(f"{message}one of these", file=file, key=key)
    if unit not in UNITS_PER_METRE:
        message = "the file does not say the unit of its lengths: set it to m, cm or mm"
    elif option and unit != option:
        message = f"the file's lengths are in {unit}, not in {option}; mend the option"
    if message:
        raise RecordingError(message, file=file, key="dataset.mocap.unit")
    return unit


def frame_numbers(values: np.ndarray, lines: list[int], file: Path) -> np.ndarray:
    """Return (N,) int64 of frame numbers; RecordingError at the line where one does not increase,
    is missing or not whole.
    """
    whole = np.isfinite(values) & (values == np.round(values)) & (np.abs(values) < 2**53)
    back = np.append(False, np.diff(values) <= 0)
    for wrong, what in ((~whole, "is missing or not whole"), (back, "does not increase")):
        if wrong.any():
            line = lines[int(np.argmax(wrong))]
            raise RecordingError(f"the frame number {what}", file=file, line=line)
    return values.astype(np.int64)


def rate_from_times(frame: np.ndarray, printed: np.ndarray) -> float | None:
    """Return frames a second of a file that states no rate: the whole number nearest to the mean
    rate, unless it puts a frame farther from its printed time than rounding to the decimals that
    are printed can, or half a frame: then the mean rate. None where times do not increase.
    """
    frame, time = (values[np.isfinite(printed)] for values in (frame, printed))
    if len(time) < 2 or time[-1] <= time[0]:
        return None
    mean = (frame[-1] - frame[0]) / (time[-1] - time[0])
    off = np.abs((frame - frame[0]) / max(np.round(mean), 1.0) - (time - time[0]))
    hundredths = np.allclose(time * 100, np.round(time * 100), rtol=0, atol=1e-6)
    most = max(0.5 / mean, TIME_ROUNDING if hundredths else 0.0)
    return float(np.round(mean)) if off.max() < most else float(mean)


def keeps_time(frame: np.ndarray, printed: np.ndarray, rate: float) -> bool:
    """Return whether the ``printed`` times (N,) s of the frames keep to ``rate`` (1/s), by the
    median over quarters of the take, since times jump now and then; True of too few times to tell.
    """
    frame, time = (values[np.isfinite(printed)] for values in (frame, printed))
    if len(time) < TELLING:
        return True
    lag = len(time) // 4
    passed, expected = time[lag:] - time[:-lag], (frame[lag:] - frame[:-lag]) / rate
    off = np.abs(passed - expected) - TIME_ROUNDING - RATE_TOLERANCE * expected
    return bool(np.median(off) <= 0)


@dataclass
class TakeBuilder:
    """Markers and bodies of a take, checked one by one, and their counts.

    ``announced_frames`` and ``found_frames``, ``gaps`` in the frame numbers and the
    ``skipped_frames`` in them, ``time_mismatches`` (rows whose time is not that of their frame),
    ``marker_samples``, the ``missing_samples`` among them and ``missing_poses``; taken for missing,
    ``zero_samples`` (exact zeros in all coordinates) and ``partial_samples``.
    """

    unit: str
    frame: np.ndarray  # (N,)
    rate: float  # Hz
    printed: np.ndarray | None  # (N,) s, the times that the file prints
    counts: dict[str, int]
    markers: dict[str, np.ndarray] = field(default_factory=dict)
    bodies: dict[str, RigidBody] = field(default_factory=dict)

    def __post_init__(self) -> None:
        step, self.time = np.diff(self.frame), (self.frame - self.frame[0]) / self.rate
        printed = self.time if self.printed is None else self.printed
        off = np.abs(printed - printed[:1] - self.time)
        self.counts |= {"found_frames": len(self.frame), "gaps": int(np.sum(step > 1))}
        self.counts["skipped_frames"] = int(np.sum(step - 1))
        self.counts["time_mismatches"] = int(np.sum(off > TIME_ROUNDING))
        self.counts |= {"zero_samples": 0, "partial_samples": 0}

    def position(self, position: np.ndarray, name: str, place: Place) -> np.ndarray:
        """Return (N, 3) in m of the ``position`` (N, 3) in the file's unit, lost samples as NaN;
        RecordingError at ``place(k, axis)`` beyond FARTHEST, or for a coordinate in no row.
        """
        position = position / UNITS_PER_METRE[self.unit]
        with np.errstate(invalid="ignore"):
            far = np.abs(position) > FARTHEST
        if far.any():
            k, axis = (int(index) for index in np.argwhere(far)[0])
            message = f"{name} is at {position[k, axis]:.6g} m, farther than any camera sees "
            message += f"({FARTHEST:g} m): are lengths in {self.unit}, and is the decimal mark a "
            raise RecordingError(f"{message}point?", **place(k, axis))
        missing = ~np.isfinite(position)
        sighted, lost = ~missing.all(axis=1), missing.any(axis=1)
        for axis in np.flatnonzero(missing.all(axis=0)).tolist() if sighted.any() else ():
            message = f"{name} has no {'XYZ'[axis]} in any row, but other coordinates: a column is "
            message += "missing or shifted; export the take again"
            raise RecordingError(message, **place(int(sighted.argmax()), axis))
        zero = (position == 0).all(axis=1)
        self.counts["zero_samples"] += int(zero.sum())
        self.counts["partial_samples"] += int((lost & sighted).sum())
        position[zero | lost] = np.nan
        return position

    def body(self, position: np.ndarray, turn: np.ndarray, name: str, place: Place) -> RigidBody:
        """Return the body of ``position`` (N, 3) in the file's unit and quaternion ``turn`` (N, 4);
        RecordingError at ``place(k)`` for another length than 1.
        """
        position = self.position(position, name, place)
        zero = (turn == 0).all(axis=-1)
        self.counts["zero_samples"] += int(zero.sum())
        turn = np.where((zero | np.isnan(turn).any(axis=-1))[:, None], np.nan, turn)
        with np.errstate(over="ignore"):
            length = np.linalg.norm(turn, axis=-1)
        if (off := np.abs(length - 1) > UNIT_TOLERANCE).any():
            k = int(off.argmax())
            message = f"the rotation of {name} is of the length {length[k]:.6g}, where a unit "
            message += "quaternion should stand: a number is damaged, or columns are shifted"
            raise RecordingError(message, **place(k))
        return RigidBody(position, turn)

    def take(
        self, name: str, version: str, more: Mapping[str, int], rate_from: str = ""
    ) -> MotionTake:
        """Return the take, with ``more`` counts."""
        lost = sum(np.isnan(position[:, 0]).sum() for position in self.markers.values())
        poses = [body.position + body.quaternion[:, :3] for body in self.bodies.values()]
        self.counts["marker_samples"] = len(self.markers) * len(self.frame)
        self.counts["missing_samples"] = int(lost)
        self.counts["missing_poses"] = int(sum(np.isnan(p).any(axis=-1).sum() for p in poses))
        self.counts |= more
        timed = None if self.printed is None else rate_from_times(self.frame, self.printed)
        held = self.frame, self.time, self.markers, self.bodies, self.counts, self.unit, timed
        return MotionTake(name, version, self.rate, *held, rate_from)
