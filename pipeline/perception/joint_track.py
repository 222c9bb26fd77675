"""Joint angles of one take, however they were measured, and how gaps in them are filled."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.core.errors import RecordingError


@dataclass(frozen=True)
class JointTrack:
    """Joint angles of one take.

    ``q`` (N, n) rad, m of prismatic joints, continuous in time. ``residual`` (N,) rms distance of
    the markers to the arm in m, NaN where the frame was filled in. ``counts`` of what was lost and
    repaired, which the tracker names; ``samples``: of markers, of which some are ``missing``.
    ``errors``: by joint the standard error of its angle in a frame, as far as the residuals tell.
    """

    q: np.ndarray
    residual: np.ndarray
    counts: dict[str, int]
    samples: int
    errors: dict[str, float] = field(default_factory=dict)


def fill_gaps(
    q: np.ndarray, solved: np.ndarray, max_gap: int, take: str, *, lack: str
) -> tuple[np.ndarray, dict[str, int]]:
    """Angles ``q`` (N, n) without leaps of whole turns, linear in time across gaps and held at the
    ends of the take, and the frames ``interpolated`` and ``held``.

    Raises RecordingError where no frame is ``solved`` (N,), which is for ``lack``, or more than
    ``max_gap`` in a row are not.
    """
    frames = np.flatnonzero(solved)
    if not len(frames):
        raise RecordingError(f"no frame {lack}", take=take)
    edges = np.concatenate([[-1], frames, [len(q)]])
    longest = int(np.argmax(np.diff(edges)))
    if edges[longest + 1] - edges[longest] - 1 > max_gap:
        raise RecordingError(
            f"markers give no joint angles for longer than {max_gap} frames: repair the labels, "
            "or leave the take out",
            take=take,
            frames=f"{edges[longest] + 1} to {edges[longest + 1] - 1}",
        )
    known = np.unwrap(q[frames], axis=0)
    q = np.stack([np.interp(np.arange(len(q)), frames, joint) for joint in known.T], axis=1)
    held = int(frames[0] + len(q) - 1 - frames[-1])
    return q, {"interpolated": len(q) - len(frames) - held, "held": held}
