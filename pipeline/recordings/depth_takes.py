"""Depth takes after ingest: offset of the camera's clock from the motion capture's clock, points on
the arm, and the joint angles that fit the points.
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm, arm_of
from pipeline.core import contracts
from pipeline.core.columns import columns, members, values
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import RecordingError
from pipeline.core.options.analysis import ArticulationSection, Compute
from pipeline.core.options.dataset import Depth, Robot
from pipeline.perception.articulation import articulate_rows
from pipeline.recordings.quality import (
    DEPTH_CAMERA,
    FEWEST_FRAMES,
    OTHERS,
    quality_row,
    residual_share,
)

MOTION, DEPTH, TRACK = (
    Path("data/ingest/motion"),
    Path("data/ingest/depth"),
    Path("data/track"),
)
GRID = 0.005  # s, step of the coarse search, short relative to any motion of an arm
MIN_OVERLAP = 0.5  # least share of the first signal that is within the second
MIN_SAMPLES = 10  # least number of samples of a signal
MIN_CORRELATION = 0.9
MOST_BIAS = (
    0.02  # rad: ≤ 0.006 in the laboratory; 0.025 for 2 % of fx, 0.042 or more for 5 %
)
REFUSED_BIAS = (
    0.2  # rad: that of another arm or camera; mirrored images make 0.7 or more
)
WITHOUT_GAPS = 0.8  # quantile of the residual


class Offset(NamedTuple):
    """Clock offset in the middle of a take, multiple correlation, drift, and standard errors."""

    value: float  # s
    standard_error: float  # s
    correlation: float
    drift: float  # s/s
    drift_standard_error: float  # s/s
    residual: (
        float  # of ``a`` from the affine map of ``b``, 0.8 quantile, in the unit of a
    )


def find_offset(
    t_a: np.ndarray,
    a: np.ndarray,
    t_b: np.ndarray,
    b: np.ndarray,
    search=(-0.5, 0.5),
    take="",
) -> Offset:
    """Return the offset τ that minimises ‖a(t) − B·b(t + τ) − c‖² over τ, matrix B and vector c. B
    and c allow for different measured points of the moving body and are eliminated for every τ
    (variable projection, Golub and Pereyra 1973).

    ``t_a`` (F,) and ``t_b`` (K,) s increase, each on one instrument's clock. ``a`` (F, d) and ``b``
    (K, e) are finite, in any units; a cubic spline interpolates b. Raises RecordingError (take) for
    signals that are too short, constant, uncorrelated or fit best at the edge of ``search`` (s).
    """
    from scipy.interpolate import CubicSpline
    from scipy.optimize import minimize_scalar

    refusal = partial(RecordingError, take=take)
    for t, signal in ((t_a, a), (t_b, b)):
        if len(t) < MIN_SAMPLES or np.any(np.diff(t) <= 0):
            message = f"no clock offset: a signal has fewer than {MIN_SAMPLES} samples, or times"
            raise refusal(f"{message} that do not increase")
        if not np.ptp(signal, axis=0).any():
            raise refusal(
                "no motion to compare the clocks by: one of the signals is constant"
            )
    spline, centre = CubicSpline(t_b, b), b.mean(axis=0)

    def inside(tau: float) -> np.ndarray:
        return (t_a + tau >= t_b[0]) & (t_a + tau <= t_b[-1])

    def fit(tau: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return ``a`` within the times of ``b``, the regressors, the affine map (B and c) and the
        residuals.
        """
        use = inside(tau)
        regressors = np.ones((use.sum(), b.shape[1] + 1))
        regressors[:, :-1] = spline(t_a[use] + tau) - centre
        affine = np.linalg.lstsq(regressors, a[use], rcond=None)[0]
        return a[use], regressors, affine, a[use] - regressors @ affine

    def unexplained(tau: float) -> float:
        """Return the unexplained share of the variance of ``a`` within the times of ``b``."""
        seen, *_, residual = fit(tau)
        return float((residual**2).sum() / ((seen - seen.mean(axis=0)) ** 2).sum())

    grid = np.linspace(*search, max(3, round((search[1] - search[0]) / GRID) + 1))
    least = max(MIN_OVERLAP * len(t_a), 2 * b.shape[1] + 4)
    grid = grid[[inside(tau).sum() >= least for tau in grid]]
    best = int(np.argmin([unexplained(tau) for tau in grid])) if len(grid) else 0
    if best in (0, len(grid) - 1):
        message = "the clock offset lies at the edge of the search range or of the signals' overlap"
        raise refusal(
            message, search=search, offset=grid[best : best + 1].round(4).tolist()
        )
    bounds, options = (grid[best - 1], grid[best + 1]), {"xatol": 1e-7}
    tau = float(
        minimize_scalar(unexplained, bounds=bounds, method="bounded", options=options).x
    )
    correlation = float(np.sqrt(max(0.0, 1.0 - unexplained(tau))))
    if correlation < MIN_CORRELATION:
        message = "the signals of the two instruments are not alike at any clock offset: no motion"
        raise refusal(
            f"{message}, or not the same take", correlation=round(correlation, 3)
        )
    _, regressors, affine, residual = fit(tau)
    time, square = t_a[inside(tau)], (residual**2).sum()
    slope = spline.derivative()(time + tau) @ affine[:-1]
    # derivatives by offset and drift, without their projection on B and c
    late, drifting = (
        each - regressors @ np.linalg.lstsq(regressors, each, rcond=None)[0]
        for each in (slope, (time - time.mean())[:, None] * slope)
    )
    drifting -= late * ((drifting * late).sum() / (late**2).sum())
    drift = float((drifting * residual).sum() / (drifting**2).sum())
    # a positive autocorrelation (AR(1)) inflates the variance; a negative one is ignored
    lag = max((residual[1:] * residual[:-1]).sum() / square if square else 0.0, 0.0)
    freedom = len(residual) - regressors.shape[1] - 1 / residual.shape[1]
    variance = (residual**2).sum(axis=0) / freedom
    information = [(each**2).sum(axis=0) for each in (late, drifting)]
    more = (1 + lag) / (1 - lag)
    errors = [
        float(np.sqrt(more * (variance * i).sum()) / i.sum()) for i in information
    ]
    # without the frames in a gap of b, which the spline bridges
    size = float(np.quantile(np.linalg.norm(residual, axis=1), WITHOUT_GAPS))
    return Offset(tau, errors[0], correlation, drift, errors[1], size)


class CameraTake(NamedTuple):
    """Rows of a depth take: frames, markers, joints, and as a comparison of other takes."""

    rows: pd.DataFrame
    markers: pd.DataFrame
    joints: list[pd.DataFrame]


def with_markers(
    frames: pd.DataFrame, markers: pd.DataFrame, joints: pd.DataFrame
) -> list[CameraTake]:
    """Return the depth takes with markers and joint angles; RecordingError without markers."""
    by_take, tracked = (
        dict(list(table.groupby("take"))) for table in (markers, joints)
    )
    names, takes = [*tracked], []
    for take, rows in frames.groupby("take", sort=False):
        if take not in by_take:
            message = "no motion-capture take has this name, so that the clock offset is unknown"
            raise RecordingError(message, file=rows["file"].iloc[0], take=take)
        following = [*names[names.index(take) :], *names][: OTHERS + 1]
        takes.append(
            CameraTake(rows, by_take[take], [tracked[name] for name in following])
        )
    return takes


def camera_residuals(
    seen: tuple[np.ndarray, np.ndarray],
    joints: list[pd.DataFrame],
    arm: Arm,
    search: tuple,
) -> list[float]:
    """Return the residuals in m of the centroids ``seen`` (times (F,) s, (F, 2) m) from the affine
    maps of the arm's joints and tip in each of the takes ``joints``; infinite for a take that does
    not move alike.
    """
    residuals = []
    for rows in joints:
        table = rows.drop(columns="residual").dropna()
        nodes = arm.chain.points(values(table, "q"))[:, 1:].reshape(len(table), -1)
        path = table["t"].to_numpy(), np.ascontiguousarray(nodes)
        try:
            residuals.append(find_offset(*seen, *path, search=search).residual)
        except RecordingError:
            residuals.append(np.inf)
    return residuals


def on_motion_clock(
    take: CameraTake, depth: Depth, arm: Arm
) -> tuple[pd.DataFrame, list[dict]]:
    """Return the rows of the table ``frames`` of a ``take`` on the motion capture's clock, and the
    quality of the offset. Unless stated, :func:`find_offset` compares the centroids of the arm's
    points and of the labelled markers in the arm's plane, and :func:`residual_share` compares the
    :func:`camera_residuals` of the take with the residuals of other takes.
    """
    rows, offset, errors = take.rows, depth.clock_offset, {}
    name = rows["take"].iloc[0]
    if offset is None:
        observed, search = rows[rows["points"] > 0], (-depth.search, depth.search)
        if observed.empty:
            message = "no frame shows the arm: check the unit of depth, the camera's pose and the"
            raise RecordingError(
                f"{message} workspace", file=rows["file"].iloc[0], take=name
            )
        signals = (
            observed["t"].to_numpy(),
            np.ascontiguousarray(observed[["x", "z"]].to_numpy()),
        )
        labelled = take.markers[take.markers.link > 0]
        plane = arm.to_plane(labelled[["x", "y", "z"]].to_numpy())
        seen = pd.DataFrame(
            {"t": labelled["t"].to_numpy(), "x": plane[:, 0], "z": plane[:, 2]}
        )
        seen = seen.groupby("t").mean(skipna=False).dropna()
        path = seen.index.to_numpy(), np.ascontiguousarray(seen.to_numpy())
        found = find_offset(*signals, *path, search=search, take=name)
        offset = found.value
        errors = {
            "clock_offset_standard_error": (found.standard_error, "s"),
            "clock_drift": (found.drift, "s/s"),
            "clock_drift_standard_error": (found.drift_standard_error, "s/s"),
            "clock_correlation": (found.correlation, "1"),
        }
        if len(take.joints) > 1 and len(observed) >= FEWEST_FRAMES:
            own, *others = camera_residuals(signals, take.joints, arm, search)
            share = residual_share(signals[1], own, others)
            errors |= {
                "camera_residual": (own, "m"),
                "camera_residual_share": (share, "share"),
            }
    quality = {"clock_offset": (offset, "s")} | errors
    rows = rows.assign(t=rows["t"] + offset)
    return rows, [
        quality_row(name, "test", DEPTH_CAMERA, k, *row) for k, row in quality.items()
    ]


def arm_points(rows: pd.DataFrame, folder: Path) -> list[np.ndarray]:
    """Return the arm's points (I, 2), m in the arm's plane, of all frames of a take."""
    take = rows["take"].iloc[0]
    return np.split(np.load(folder / f"{take}.npy"), np.cumsum(rows["points"])[:-1])


def kept_takes() -> list[pd.DataFrame]:
    """Return the rows of the table ``frames`` of every take that the stage ``track`` kept."""
    frames, joints = contracts.read("frames", TRACK), contracts.read("joints", TRACK)
    return [
        rows for _, rows in frames[frames["take"].isin(joints["take"])].groupby("take")
    ]


def articulate_takes(
    takes: list[pd.DataFrame],
    robot: Robot,
    options: ArticulationSection,
    compute: Compute,
) -> pd.DataFrame:
    """Return the table ``angles`` of ``takes`` (from :func:`kept_takes`)."""
    joints = contracts.read("joints", TRACK)
    first = joints[(joints.part == "training") & (joints.k == 0)]
    start = first[columns("q", robot.joints)].mean().to_numpy()
    known = (
        arm_of(robot),
        robot.joints,
        contracts.read("trajectory", MOTION),
        options,
        start,
    )
    fit, label = partial(_articulate, known=known), "articulate: takes"
    return pd.concat(
        run_trials(fit, takes, compute=compute, label=label), ignore_index=True
    )


def bias_warning(errors: pd.DataFrame) -> str:
    """Return a warning if the mean of one joint's angle ``errors`` (family e, rad; depth camera
    minus motion capture) exceeds MOST_BIAS, else ""; RecordingError beyond REFUSED_BIAS.
    """
    mean = errors[columns("e", members(errors, "e"))].mean()
    worst = str(mean.abs().idxmax())
    if abs(mean[worst]) <= MOST_BIAS:
        return ""
    message = f"{worst[2:]} in the depth images is {mean[worst]:+.3g} rad off the motion capture on"
    message += f" average, more than {MOST_BIAS:g}: check the camera's intrinsics (fx, fy, cx, cy;"
    message += " 5 % of fx make about 0.05 rad) and dataset.depth.camera"
    if abs(mean[worst]) > REFUSED_BIAS:
        raise RecordingError(
            f"{message}; mirrored images are not this camera's: turn them back"
        )
    return message


def _articulate(rows: pd.DataFrame, known: tuple) -> pd.DataFrame:
    return articulate_rows(rows, arm_points(rows, DEPTH), *known)
