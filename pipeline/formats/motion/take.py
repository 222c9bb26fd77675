"""Motion-capture takes of any format: markers and rigid bodies over numbered frames, in m and s."""

import re
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
TIME_ROUNDING = (
    0.0101  # s, greatest error of a step between times of two decimals or more
)
RATE_TOLERANCE = 0.01  # relative error of a stated rate, far above any clock's drift
UNIT_TOLERANCE = 0.01  # error of a quaternion's length, far above rounding
TELLING = 20  # least number of printed times that can contradict a stated rate
NO_ASSET = "the take has no marker and no rigid body"
BEFORE = (
    "solved_replaced",
    "solved_only",
    "unlabelled_points",
)  # counts listed before samples
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
    time: (
        np.ndarray
    )  # (N,) s since the first exported frame, from frame numbers and rate
    markers: dict[str, np.ndarray]  # name: (N, 3) m, NaN where occluded
    bodies: dict[str, RigidBody]
    counts: dict[
        str, int
    ]  # numbers of skipped, lost and repaired items; see the format's reader
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
    known = spelled(stated) in ("", *UNITS_PER_METRE)
    message = "the file does not state the unit of its lengths: set it to m, cm or mm"
    if stated.strip():
        message = f"lengths are in {stated!r} by {key} of the file, not in "
        message += (
            f"{option}: correct the option"
            if option
            else "m, cm or mm: export in these"
        )
    raise RecordingError(message, file=file, key="dataset.mocap.unit" if known else key)


def frame_numbers(values: np.ndarray, lines: list[int], file: Path) -> np.ndarray:
    """Return whole, increasing frame numbers (N,) int64; else RecordingError with the line."""
    whole = (
        np.isfinite(values) & (values == np.round(values)) & (np.abs(values) < 2**53)
    )
    if (invalid := ~whole | np.append(False, np.diff(values) <= 0)).any():
        line = lines[int(np.argmax(invalid))]
        message = "the frame number is missing, is not whole or does not increase"
        raise RecordingError(f"{message}; export the take again", file=file, line=line)
    return values.astype(np.int64)


def settle_rate(
    stated: str, frame: np.ndarray, printed: np.ndarray, file: Path, **where: object
) -> tuple[float, str]:
    """Return the frame rate in Hz, ``stated`` or by the ``printed`` times (N,) s, and its source if
    it is not stated. RecordingError (``where``) for no rate > 0, and where TELLING or more times
    contradict it: the median over all spans of a quarter of the take decides, since times may jump.
    """
    timed = rate_from_times(frame, printed)
    if not stated and timed is not None:
        return timed, FROM_TIMES
    rate = float(stated) if NUMBER.fullmatch(stated) else np.nan
    if 0 < rate < np.inf:
        frame, time = (values[np.isfinite(printed)] for values in (frame, printed))
        lag = max(len(time) // 4, 1)
        passed, expected = time[lag:] - time[:-lag], (frame[lag:] - frame[:-lag]) / rate
        off = np.abs(passed - expected) - TIME_ROUNDING - RATE_TOLERANCE * expected
        if len(time) < TELLING or np.median(off) <= 0:
            return rate, ""
    message = f"the frame rate is {stated!r} in the header and {timed or 0:.6g} by the printed "
    message += (
        "times (0: they do not increase); a rate > 0 that agrees with the times is "
    )
    message += "required; export the take again"
    raise RecordingError(message, file=file, **where)


def rate_from_times(frame: np.ndarray, printed: np.ndarray) -> float | None:
    """Return the frame rate in Hz by the ``printed`` times (N,) s: the mean rate rounded to an
    integer. Return the unrounded mean where the integer rate misses a printed time by more than
    rounding or half a frame, and None where times do not increase.
    """
    frame, time = (values[np.isfinite(printed)] for values in (frame, printed))
    if len(time) < 2 or time[-1] <= time[0]:
        return None
    mean = (frame[-1] - frame[0]) / (time[-1] - time[0])
    off = np.abs((frame - frame[0]) / max(np.round(mean), 1.0) - (time - time[0]))
    hundredths = np.allclose(time * 100, np.round(time * 100), rtol=0, atol=1e-6)
    most = max(0.5 / mean, TIME_ROUNDING if hundredths else 0.0)
    return float(np.round(mean)) if off.max() < most else float(mean)


def compare_frames(stated: str, found: int) -> dict[str, int]:
    """Return the counts of frames in a take whose header has the number ``stated``."""
    return compare_announced(
        "frames", int(stated) if WHOLE.fullmatch(stated) else None, found
    )


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
    frame, step = raw.frame, np.diff(raw.frame)
    time = (frame - frame[0]) / raw.rate
    printed = raw.time if len(raw.time) else time
    counts = raw.counts | {"gaps": int(np.sum(step > 1))}
    counts["skipped_frames"] = int(np.sum(step - 1))
    counts["time_mismatches"] = int(
        np.sum(np.abs(printed - printed[:1] - time) > TIME_ROUNDING)
    )
    counts |= {"zero_samples": 0, "partial_samples": 0}

    def fault(message: str, k: int, **evidence: int) -> RecordingError:
        place = {"frame": int(frame[k])} if lines is None else {"line": lines[k]}
        return RecordingError(message, file=file, **place, **evidence)

    def check_position(position: np.ndarray, name: str) -> np.ndarray:
        zero, filler = (
            (position == 0).all(axis=1),
            (position == position[:, :1]).all(axis=1),
        )
        filler &= ~zero & (np.abs(position[:, 0]) >= LEAST_FILLER)
        position = (
            np.where(filler[:, None], np.nan, position) / UNITS_PER_METRE[raw.unit]
        )
        missing, far = ~np.isfinite(position), np.abs(position) > FARTHEST
        sighted, lost = ~missing.all(axis=1), missing.any(axis=1)
        absent = missing.all(axis=0) & sighted[:, None]
        if (invalid := far if far.any() else absent).any():
            k, axis = (int(index) for index in np.argwhere(invalid)[0])
            message = f"{name} has no {'XYZ'[axis]} in any row, but other coordinates: a column is "
            message += "missing or shifted; export the take again"
            if far.any():
                message = f"{name} is at {position[k, axis]:.6g} m, farther than any camera sees "
                message += f"({FARTHEST:g} m): are lengths in {raw.unit}, and is the decimal mark "
                message += "a point?"
            raise fault(
                message, k, **({"column": columns[name][axis] + 1} if columns else {})
            )
        counts["zero_samples"] += int(zero.sum())
        if filler.any():
            counts["filler_samples"] = counts.get("filler_samples", 0) + int(
                filler.sum()
            )
        counts["partial_samples"] += int((lost & sighted).sum())
        position[zero | lost] = np.nan
        return position

    markers = {
        name: check_position(position, name) for name, position in raw.markers.items()
    }
    seen = np.vstack([np.empty((0, 3)), *markers.values()])
    seen = seen[np.isfinite(seen).all(axis=1)]
    extent = np.ptp(seen, axis=0).max() if len(seen) else 0.0
    if len(markers) > 1 and 0 < extent < NEAREST:
        message = f"all {len(markers)} markers lie within {1000 * extent:.3g} mm, less than one's"
        message += (
            f" size: are lengths in {raw.unit}? Export the take again, in another unit"
        )
        raise RecordingError(message, file=file)
    bodies = {}
    for name, body in raw.bodies.items():
        position, rotation = check_position(body.position, name), body.quaternion
        zero = (rotation == 0).all(axis=-1)
        counts["zero_samples"] += int(zero.sum())
        rotation = np.where(
            (zero | np.isnan(rotation).any(axis=-1))[:, None], np.nan, rotation
        )
        with np.errstate(over="ignore"):
            length = np.linalg.norm(rotation, axis=-1)
        if (off := np.abs(length - 1) > UNIT_TOLERANCE).any():
            k = int(off.argmax())
            message = f"the quaternion of {name} has the length {length[k]:.6g}, 1 is required: a "
            message += (
                "number is damaged, or columns are shifted; export the take again"
            )
            raise fault(message, k)
        bodies[name] = RigidBody(position, rotation)
    poses = [body.position + body.quaternion[:, :3] for body in bodies.values()]
    counts |= {name: more[name] for name in BEFORE if more and name in more}
    counts["marker_samples"] = len(markers) * len(frame)
    counts["missing_samples"] = int(
        sum(np.isnan(xyz[:, 0]).sum() for xyz in markers.values())
    )
    counts["missing_poses"] = int(
        sum(np.isnan(pose).any(axis=-1).sum() for pose in poses)
    )
    checked = {"time": time, "markers": markers, "bodies": bodies}
    return replace(raw, counts=counts | (more or {}), **checked)
