"""The depth camera's noise in the joint angles: its mean and covariance over the time of the motion, as other takes show it."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.errors import RecordingError

COMPONENTS = ["e1", "e2", "e3"]
MIN_SAMPLES = 4  # a 3 × 3 covariance of fewer samples is singular


def errors_of(angles: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Depth camera minus motion capture at every depth frame during the motion, the motion capture interpolated linearly at its time.

    ``angles``: columns take, frame, t (s), q1, q2, q3 (rad) of the depth camera; ``joints``: take, t, q1, q2, q3 of the motion capture, in
    the order of time. Returns take, frame, t, e1, e2, e3 (rad).
    """
    errors = []
    for take, rows in angles.groupby("take"):
        truth = joints[joints["take"] == take]
        inside = rows[(rows["t"] >= 0) & (rows["t"] <= truth["t"].iloc[-1])]
        difference = {f"e{j}": inside[f"q{j}"] - np.interp(inside["t"], truth["t"], truth[f"q{j}"]) for j in (1, 2, 3)}
        errors.append(inside[["take", "frame", "t"]].assign(**difference))
    return pd.concat(errors, ignore_index=True)


def leave_one_out(errors: pd.DataFrame, *, window: int) -> pd.DataFrame:
    """Mean and covariance of the noise at each frame without the take that they will be used on, and ('none') of all takes.

    ``errors``: columns take, frame, t (s), e1, e2, e3 (rad), depth camera minus motion capture. The mean of a frame is that over the other
    takes; the covariance is that of their deviations from the means, pooled over ``window`` frames on either side, so that it
    varies with time as smoothly as a moving arm looks. Returns the table ``kinect_noise``. Raises RecordingError where the other
    takes are too few, or have no such frame.
    """
    rows = []
    for left_out in [*errors["take"].unique(), "none"]:
        others = errors[errors["take"] != left_out]
        by_frame = others.groupby("frame")
        mean, time, count = by_frame[COMPONENTS].mean(), by_frame["t"].mean(), by_frame.size()
        centred = others[COMPONENTS].to_numpy() - mean.loc[others["frame"]].to_numpy()
        frames = mean.index.to_numpy()
        place = pd.Series(np.arange(len(frames)), frames)[others["frame"]].to_numpy()
        scatter = np.zeros((len(frames), 3, 3))
        np.add.at(scatter, place, centred[:, :, None] * centred[:, None, :])
        near = np.abs(frames[:, None] - frames[None, :]) <= window
        # one degree of freedom is spent on each frame's mean
        freedom = near @ (count.to_numpy() - 1)
        if len(frames) == 0 or freedom.min() < MIN_SAMPLES:
            raise RecordingError(
                "too few test takes to estimate the depth camera's noise from the others; record more, or widen articulation.noise_window",
                take=left_out, samples=int(freedom.min()) if len(frames) else 0,
            )  # fmt: skip
        covariance = np.tensordot(near, scatter, axes=1) / freedom[:, None, None]
        table = {"take": left_out, "frame": frames, "t": time.to_numpy()}
        table |= {f"b{j}": mean[f"e{j}"].to_numpy() for j in (1, 2, 3)}
        table |= {f"r{i}{j}": covariance[:, i - 1, j - 1] for i in (1, 2, 3) for j in range(i, 4)}
        rows.append(pd.DataFrame(table))
    return pd.concat(rows, ignore_index=True)
