"""Motion-capture takes of any format: markers and rigid bodies over numbered frames, in m and s."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import NUMBER, spelled
from pipeline.formats.format import compare_announced

UNITS_PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
FARTHEST = 100.0  # m, greatest coordinate
NEAREST = 0.003  # m, least extent of all markers of a take: the size of one
# names that capture programs give to markers without a name
STRAY = re.compile(r"(Marker-|Unlabeled[: ]?|\*)\d+|")
LEAST_FILLER = 99.0  # in any unit: three equal coordinates beyond it fill a gap
WHOLE = re.compile(r"[0-9]{1,18}")  # a count or an ID
# s, greatest error of a step between times of two decimals or more
TIME_ROUNDING = 0.0101
RATE_TOLERANCE = 0.01  # relative error of a stated rate, far above any clock's drift
UNIT_TOLERANCE = 0.01  # error of a quaternion's length, far above rounding
TELLING = 20  # least number of printed times that can contradict a stated rate
NO_ASSET = "the take has no marker and no rigid body"
# counts listed before samples
BEFORE = ("solved_replaced", "solved_only", "unlabelled_points")
FROM_TIMES = "the printed times: the file states no rate"


class RigidBody(NamedTuple):
    """Pose of a rigid body's pivot in the world frame, NaN where the body was lost."""

    position: np.ndarray  # (N, 3) m
    quaternion: np.ndarray  # (N, 4) x, y, z, w; the sign is as recorded and may flip


@dataclass(frozen=True)
class MotionTake:
    """One take of N frames in the capture's world frame (right-handed; Motive: y up)."""

    name: str
    version: str  # format version
    rate: float  # Hz, rate of the frame numbers
    frame: np.ndarray  # (N,) int64, increasing; gaps are frames that were not exported
    # (N,) s since the first exported frame, from frame numbers and rate
    time: np.ndarray
    markers: dict[str, np.ndarray]  # name: (N, 3) m, NaN where occluded
    bodies: dict[str, RigidBody]
    # numbers of skipped, lost and repaired items; see the format's reader
    counts: dict[str, int]
    unit: str = "m"  # unit of lengths in the file
    rate_from: str = ""  # source of ``rate``, if the file does not state it


def settle_unit(stated: str, option: str | None, file: Path, *, key: str) -> str:
    """Return the unit of a file's lengths (m, cm or mm): the unit ``stated`` under the file's
    ``key``, else the ``option``. Raises RecordingError for another unit, for no unit, and where
    ``stated`` and ``option`` differ.
    """
    unit = spelled(stated) or option
    if unit in UNITS_PER_METRE and option in (None, unit):
        return unit
    by_header = f"lengths are in {stated!r} by {key} of the file"
    if not stated.strip():
        message = (
            "the file does not state the unit of its lengths: set it to m, cm or mm"
        )
    elif option:
        message = f"{by_header}, not in {option}: correct the option"
    else:
        message = f"{by_header}, not in m, cm or mm: export in these"
    by_option = spelled(stated) in ("", *UNITS_PER_METRE)
    key = "dataset.mocap.unit" if by_option else key
    raise RecordingError(message, file=file, key=key)


def frame_numbers(values: np.ndarray, lines: list[int], file: Path) -> np.ndarray:
    """Return whole, increasing frame numbers (N,) int64; else RecordingError with the line."""
    whole = np.isfinite(values) & (values == np.round(values))
    invalid = ~whole | (np.abs(values) >= 2**53)
    invalid[1:] |= np.diff(values) <= 0
    if invalid.any():
        raise RecordingError(
            "the frame number is missing, is not whole or does not increase; export the take again",
            file=file,
            line=lines[int(np.argmax(invalid))],
        )
    return values.astype(np.int64)


def settle_rate(
    stated: str,
    frame: np.ndarray,
    printed: np.ndarray,
    file: Path,
    **where: object,
) -> tuple[float, str]:
    """Return the frame rate in Hz, ``stated`` or by the ``printed`` times (N,) s, and its source if
    it is not stated. RecordingError (``where``) for no rate > 0, and where the times contradict it.
    """
    by_times = rate_from_times(frame, printed)
    if not stated and by_times is not None:
        return by_times, FROM_TIMES
    rate = float(stated) if NUMBER.fullmatch(stated) else np.nan
    if 0 < rate < np.inf and not _is_contradicted(rate, frame, printed):
        return rate, ""
    raise RecordingError(
        f"the frame rate is {stated!r} in the header and {by_times or 0:.6g} by the printed times "
        "(0: they do not increase); a rate > 0 that agrees with the times is required; export the "
        "take again",
        file=file,
        **where,
    )


def _is_contradicted(rate: float, frame: np.ndarray, printed: np.ndarray) -> bool:
    """Return whether TELLING or more ``printed`` times (N,) s contradict the ``rate`` in Hz: the
    median over all spans of a quarter of the take decides, since times may jump.
    """
    timed = np.isfinite(printed)
    frame = frame[timed]
    time = printed[timed]
    if len(time) < TELLING:
        return False
    lag = len(time) // 4
    passed = time[lag:] - time[:-lag]
    expected = (frame[lag:] - frame[:-lag]) / rate
    off = np.abs(passed - expected) - TIME_ROUNDING - RATE_TOLERANCE * expected
    return bool(np.median(off) > 0)


def rate_from_times(frame: np.ndarray, printed: np.ndarray) -> float | None:
    """Return the frame rate in Hz by the ``printed`` times (N,) s: the mean rate rounded to an
    integer. Return the unrounded mean where the integer rate misses a printed time by more than
    rounding or half a frame, and None where times do not increase.
    """
    timed = np.isfinite(printed)
    frame = frame[timed]
    time = printed[timed]
    if len(time) < 2 or time[-1] <= time[0]:
        return None
    frames = frame - frame[0]
    seconds = time - time[0]
    mean = frames[-1] / seconds[-1]
    whole = np.round(mean)
    off = np.abs(frames / max(whole, 1.0) - seconds)
    hundredths = time * 100
    rounding = 0.0
    if np.allclose(hundredths, np.round(hundredths), rtol=0, atol=1e-6):
        rounding = TIME_ROUNDING
    is_whole = off.max() < max(0.5 / mean, rounding)
    return float(whole if is_whole else mean)


def compare_frames(stated: str, frames: int) -> dict[str, int]:
    """Return the counts of frames in a take whose header has the number ``stated``."""
    announced = int(stated) if WHOLE.fullmatch(stated) else None
    return compare_announced("frames", announced, frames)


def checked_take(
    raw: MotionTake,
    file: Path,
    lines: Sequence[int] | None = None,
    columns: Mapping[str, Sequence[int]] | None = None,
    more: Mapping[str, int] | None = None,
) -> MotionTake:
    """Return the take in m and s, with lost samples as NaN. ``raw`` has positions in the file's
    unit and printed times (N,) s or (0,). ``counts`` are the counts of ``raw`` and ``more``,
    ``gaps`` of the frame numbers, ``skipped_frames`` in the gaps,
    ``time_mismatches``, missing samples and poses, ``zero_samples`` (all coordinates 0),
    ``partial_samples`` (some coordinates missing), and ``filler_samples`` if there are any (all
    coordinates equal and at least LEAST_FILLER, as 9999 in a gap). Raises RecordingError, with the
    frame or its line and the column, for a coordinate beyond FARTHEST, a coordinate that is missing
    in all rows, and a quaternion whose length is not 1.
    """
    more = more or {}
    time = (raw.frame - raw.frame[0]) / raw.rate
    printed = raw.time if len(raw.time) else time
    late = np.abs(printed - printed[:1] - time) > TIME_ROUNDING
    step = np.diff(raw.frame)
    samples = _Samples(raw, file, lines, columns)
    markers = {}
    bodies = {}
    for name, position in raw.markers.items():
        markers[name] = samples.position(position, name)
    _require_extent(markers, raw.unit, file)
    for name, body in raw.bodies.items():
        position = samples.position(body.position, name)
        bodies[name] = RigidBody(position, samples.rotation(body.quaternion, name))

    missing_samples = missing_poses = 0
    for position in markers.values():
        missing_samples += int(np.sum(np.isnan(position[:, 0])))
    for position, quaternion in bodies.values():
        lost = np.isnan(position[:, 0]) | np.isnan(quaternion[:, 0])
        missing_poses += int(np.sum(lost))
    listed_first = {name: more[name] for name in BEFORE if name in more}
    counts = {
        **raw.counts,
        "gaps": int(np.sum(step > 1)),
        "skipped_frames": int(np.sum(step - 1)),
        "time_mismatches": int(np.sum(late)),
        **samples.counts,
        **listed_first,
        "marker_samples": len(markers) * len(raw.frame),
        "missing_samples": missing_samples,
        "missing_poses": missing_poses,
        **more,
    }
    return replace(raw, counts=counts, time=time, markers=markers, bodies=bodies)


class _Samples:
    """Check of the samples of a take, with counts of the missing ones."""

    def __init__(
        self,
        raw: MotionTake,
        file: Path,
        lines: Sequence[int] | None,
        columns: Mapping[str, Sequence[int]] | None,
    ) -> None:
        self.raw = raw
        self.file = file
        self.lines = lines
        self.columns = columns
        self.counts = Counter({"zero_samples": 0, "partial_samples": 0})

    def position(self, position: np.ndarray, name: str) -> np.ndarray:
        """Return the ``position`` (N, 3) of a marker or body in m, NaN where it is lost."""
        zero = (position == 0).all(axis=1)
        equal = (position == position[:, :1]).all(axis=1)
        filler = equal & (np.abs(position[:, 0]) >= LEAST_FILLER)
        position = np.where(filler[:, None], np.nan, position)
        position = position / UNITS_PER_METRE[self.raw.unit]

        finite = np.isfinite(position)
        sighted = finite.any(axis=1)
        whole = finite.all(axis=1)
        self._require_plausible(position, sighted, name)
        self.counts["zero_samples"] += int(np.sum(zero))
        if filler.any():
            self.counts["filler_samples"] += int(np.sum(filler))
        self.counts["partial_samples"] += int(np.sum(sighted & ~whole))
        position[zero | ~whole] = np.nan
        return position

    def _require_plausible(
        self,
        position: np.ndarray,
        sighted: np.ndarray,
        name: str,
    ) -> None:
        """Raise RecordingError for a coordinate beyond FARTHEST, and for one that is missing in all
        rows of a marker that is ``sighted`` (N,) in some.
        """
        far = np.abs(position) > FARTHEST
        absent = (~np.isfinite(position)).all(axis=0) & sighted[:, None]
        invalid = far if far.any() else absent
        if not invalid.any():
            return
        row, axis = np.argwhere(invalid)[0].tolist()
        message = (
            f"{name} has no {'XYZ'[axis]} in any row, but other coordinates: a column is missing "
            "or shifted; export the take again"
        )
        if far.any():
            message = (
                f"{name} is at {position[row, axis]:.6g} m, farther than any camera sees "
                f"({FARTHEST:g} m): are lengths in {self.raw.unit}, and is the decimal mark a "
                "point?"
            )
        evidence = {}
        if self.columns:
            evidence["column"] = self.columns[name][axis] + 1
        raise self._fault(message, row, **evidence)

    def rotation(self, quaternion: np.ndarray, name: str) -> np.ndarray:
        """Return the ``quaternion`` (N, 4) of a body, NaN where it is lost; RecordingError for a
        length other than 1.
        """
        zero = (quaternion == 0).all(axis=-1)
        self.counts["zero_samples"] += int(np.sum(zero))
        lost = zero | np.isnan(quaternion).any(axis=-1)
        rotation = np.where(lost[:, None], np.nan, quaternion)
        with np.errstate(over="ignore"):
            length = np.linalg.norm(rotation, axis=-1)
        off = np.abs(length - 1) > UNIT_TOLERANCE
        if off.any():
            row = int(off.argmax())
            message = (
                f"the quaternion of {name} has the length {length[row]:.6g}, 1 is required: a "
                "number is damaged, or columns are shifted; export the take again"
            )
            raise self._fault(message, row)
        return rotation

    def _fault(self, message: str, row: int, **evidence: int) -> RecordingError:
        if self.lines is None:
            evidence["frame"] = int(self.raw.frame[row])
        else:
            evidence["line"] = self.lines[row]
        return RecordingError(message, file=self.file, **evidence)


def _require_extent(markers: Mapping[str, np.ndarray], unit: str, file: Path) -> None:
    """Raise RecordingError where several ``markers`` lie within the size of one."""
    if len(markers) < 2:
        return
    positions = np.vstack([*markers.values()])
    seen = positions[np.isfinite(positions).all(axis=1)]
    extent = np.ptp(seen, axis=0).max() if len(seen) else 0.0
    if 0 < extent < NEAREST:
        raise RecordingError(
            f"all {len(markers)} markers lie within {1000 * extent:.3g} mm, less than one's size: "
            f"are lengths in {unit}? Export the take again, in another unit",
            file=file,
        )
