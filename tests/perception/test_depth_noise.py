"""The depth camera's noise as the other takes show it, and the slope of its error."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from pipeline.core import contracts
from pipeline.core.columns import columns, pairs, spread
from pipeline.core.errors import RecordingError
from pipeline.perception.depth_noise import (
    ALL,
    NEAR_A_SAMPLE,
    error_slopes,
    errors_of,
    leave_one_out,
)
from pipeline.perception.depth_noise import deviations as deviations_of

BIAS = np.array([0.01, -0.02, 0.005])
FRAMES = 12
JOINTS = ("shoulder", "elbow", "wrist")
ERRORS = columns("e", JOINTS)
MEAN = columns("b", JOINTS)
COVARIANCE = pairs("r", JOINTS)
UPPER = np.triu_indices(3)


ROOT = 1e-3 * np.array([[4.0, 0.0, 0.0], [-3.0, 2.0, 0.0], [1.0, -1.0, 5.0]])


def errors(takes: int) -> pd.DataFrame:
    """Errors whose mean and covariance grow over the motion."""
    rng = default_rng(41)
    frames = np.arange(FRAMES)
    growing = 1 + frames[:, None] / FRAMES
    tables = []
    for take in range(takes):
        drawn = rng.standard_normal((FRAMES, 3)) @ ROOT.T
        noise = np.outer(frames, BIAS) + growing * drawn
        times = frames / 30 + rng.normal(0, 1e-3, FRAMES)
        named = {"take": f"test_{take}", "frame": frames, "t": times}
        tables.append(pd.DataFrame(named | spread("e", JOINTS, noise)))
    return pd.concat(tables, ignore_index=True)


def rows_of_take(table: pd.DataFrame, take: str) -> pd.DataFrame:
    return table[table["take"] == take].reset_index(drop=True)


def test_a_take_has_no_say_in_its_own_noise():
    before = errors(8)
    after = before.copy()
    changed = after["take"] == "test_3"
    after.loc[changed, ERRORS] += 10.0
    after.loc[changed, "t"] += 1.0

    noise, noise_after = (leave_one_out(table, window=2) for table in (before, after))
    of_others = leave_one_out(before[~changed], window=2)

    of_take = rows_of_take(noise, "test_3")
    pd.testing.assert_frame_equal(of_take, rows_of_take(noise_after, "test_3"))
    # it is what the other takes alone would give
    without = rows_of_take(of_others, "none").assign(take="test_3")
    pd.testing.assert_frame_equal(of_take, without)
    # control: on every other take it has
    for take in ("test_0", "test_7", "none"):
        mean, mean_after = (rows_of_take(x, take)[MEAN] for x in (noise, noise_after))
        assert np.all(mean != mean_after)


@pytest.mark.parametrize("window", [0, 2])
def test_it_is_the_sample_mean_and_the_pooled_covariance_of_the_takes_that_have_a_frame(
    tmp_path,
    window,
):
    table = errors(9)
    table = table[~((table["frame"] == 4) & table["take"].isin(["test_0", "test_1"]))]
    noise = leave_one_out(table, window=window)
    contracts.write(noise, "kinect_noise", tmp_path)
    noise = rows_of_take(noise, "none")

    by_frame = table.groupby("frame")
    samples = [rows[ERRORS].to_numpy() for _, rows in by_frame]
    # each frame's own mean is taken off, however it changes over the motion
    freedom = np.array([len(of_frame) - 1 for of_frame in samples])
    scatter = np.array([np.cov(of_frame.T) for of_frame in samples])
    scatter *= freedom[:, None, None]
    times = by_frame["t"].mean()
    for frame, of_frame in enumerate(samples):
        near = slice(max(frame - window, 0), frame + window + 1)
        covariance = scatter[near].sum(axis=0) / freedom[near].sum()
        expected = [*of_frame.mean(axis=0), *covariance[UPPER], times[frame]]
        estimate = noise.loc[frame, [*MEAN, *COVARIANCE, "t"]].astype(float)
        assert_allclose(estimate, expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("takes", "window", "enough"),
    [(5, 0, 6), (3, 2, 4), (1, 5, 3)],
)
def test_fewer_takes_than_a_covariance_needs_are_refused(takes, window, enough):
    # the other takes spend one degree of freedom on each mean, and the window reaches over window +
    # 1 frames at the ends; a covariance of three joints from fewer than four samples is singular
    with pytest.raises(RecordingError, match="too few test takes") as refused:
        leave_one_out(errors(takes), window=window)
    assert refused.value.evidence["take"] == "test_0"
    assert refused.value.evidence["samples"] == max(0, (takes - 2) * (window + 1))
    leave_one_out(errors(enough), window=window)


def test_a_frames_error_is_against_the_motion_at_its_own_time_and_none_is_outside_the_motion():
    t = np.arange(5) * 0.01
    exposed = np.array([-0.001, 0.0, 0.0135, 0.04, 0.0401])
    slopes = np.arange(1, 4)
    measured = spread("q", JOINTS, np.outer(t, slopes))
    joints = pd.DataFrame({"take": "test_1", "t": t} | measured)
    seen = spread("q", JOINTS, np.outer(exposed + 0.1, slopes))
    angles = pd.DataFrame({"take": "test_1", "frame": range(5), "t": exposed} | seen)

    deviations = errors_of(angles, joints)

    assert deviations["frame"].tolist() == [1, 2, 3]
    assert_allclose(deviations[ERRORS], [[0.1, 0.2, 0.3]] * 3)
    # control: at the times of other frames they are not
    later = errors_of(angles.assign(t=exposed + 0.005), joints)
    assert np.abs(later[ERRORS[2]] - 0.3).min() > 0.01


PAIR = ("a", "b")
STEP = 0.01
TAKES = 40
SAMPLES = 101
SLOPE = np.array([0.0, -0.6])
# rad, of arm and camera
DEVIATION = 5e-3
NOISE = 4e-3
NONE = np.zeros((2, 2))


@cache
def recordings(
    *,
    share: float,
    lasts: bool,
    pose: float = 0.0,
    jump: float = 0.0,
    common: float = 0.0,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Errors and joints of TAKES takes, every third sample a frame that is ``share`` of a step
    late; deviations that last a whole take, or are new at every instant.

    In rad: ``pose`` is the noise of the motion capture, ``jump`` what the number of a frame adds to
    an error, ``common`` the standard deviation of what a take adds.
    """
    rng = default_rng(4)
    path = np.linspace(0, 1, SAMPLES)[:, None] * [1.0, -2.0]
    k = np.arange(SAMPLES)
    frames = np.arange(0, SAMPLES - 1, 3)
    at_frames = path[frames] + share * (path[frames + 1] - path[frames])
    joints = []
    angles = []
    for number in range(2 * TAKES):
        at_samples, between = rng.normal(scale=DEVIATION, size=(2, SAMPLES, 2))
        if lasts:
            at_samples = between = np.tile(at_samples[0], (SAMPLES, 1))
        measured = path + at_samples + rng.normal(scale=pose, size=path.shape)
        use = "training" if number < TAKES else "test"
        name = {"take": f"take_{number:03d}", "part": use}
        sampled = name | {"k": k, "t": k * STEP}
        joints.append(pd.DataFrame(sampled | spread("q", PAIR, measured)))
        if use == "training":
            continue

        deviation = (between if share else at_samples)[frames]
        noise = rng.normal(scale=NOISE, size=deviation.shape)
        y = at_frames + deviation * (1 + SLOPE) + noise
        y += jump * np.sin(frames)[:, None] + rng.normal(scale=common, size=2)
        seen = name | {"frame": frames, "t": (frames + share) * STEP}
        angles.append(pd.DataFrame(seen | spread("q", PAIR, y)))
    joints = pd.concat(joints, ignore_index=True)
    return errors_of(pd.concat(angles, ignore_index=True), joints), joints


def slopes(frames: str, noise: np.ndarray = NONE, **how: float) -> pd.DataFrame:
    table = error_slopes(deviations_of(*recordings(**how)), STEP, noise)
    return table[table["frames"] == frames].set_index("joint")


def distance(rows: pd.DataFrame) -> np.ndarray:
    """Distance of each joint's slope from SLOPE, in standard errors."""
    return np.abs(rows["slope"].to_numpy() - SLOPE) / rows["standard_error"].to_numpy()


# 4 standard errors: one test in ten thousand fails by chance
def test_the_slope_that_was_put_in_comes_out_whatever_bias_a_frame_has():
    rows = slopes(NEAR_A_SAMPLE, share=0.0, lasts=False, jump=0.05)
    assert np.all(distance(rows) < 4)
    assert np.all(rows["standard_error"] < 0.05)
    # control: it is told from no slope
    assert rows.loc["b", "slope"] < -10 * rows.loc["b", "standard_error"]


def test_the_standard_error_knows_what_the_errors_of_a_take_have_in_common():
    common = 8e-3
    rows = slopes(ALL, share=0.5, lasts=True, common=common)
    assert np.all(distance(rows) < 4)
    # one pair of deviation and error a take; were frames independent it would be a fifth of this
    expected = common / (DEVIATION * np.sqrt(TAKES))
    assert_allclose(rows["standard_error"], expected, rtol=0.35)


def test_the_motion_captures_own_noise_makes_no_slope_once_it_is_known():
    pose = 2e-3
    how = {"share": 0.0, "lasts": False, "pose": pose}
    without_noise = slopes(NEAR_A_SAMPLE, pose**2 * np.eye(2), **how)
    assert np.all(distance(without_noise) < 4)
    # control: where it is taken for nothing it does
    assert distance(slopes(NEAR_A_SAMPLE, **how))[0] > 4


def test_between_samples_deviations_that_do_not_last_make_a_slope_of_their_own():
    """A camera without any dependence seems to have one: the line between two samples is no
    deviation of the arm at the frame's time.
    """
    rows = slopes(ALL, share=0.5, lasts=False)
    assert rows.loc["a", "slope"] == pytest.approx(-1.0, abs=0.1)
    # controls: neither at a sample nor where they last
    for how in ({"share": 0.0, "lasts": False}, {"share": 0.5, "lasts": True}):
        assert slopes(ALL, **how).loc["a", "slope"] == pytest.approx(0.0, abs=0.1)
