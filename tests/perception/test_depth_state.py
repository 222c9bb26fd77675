"""The slope of the depth camera's error on the deviation: what is put in comes out, the motion
capture's own noise makes none, and frames between samples are told apart.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.columns import spread
from pipeline.perception.depth_noise import (
    ALL,
    NEAR_A_SAMPLE,
    deviations,
    error_slopes,
    errors_of,
    slope_scores,
)

JOINTS, STEP, TAKES, SAMPLES = ("a", "b"), 0.01, 40, 101
SLOPE = np.array([0.0, -0.6])
DEVIATION, NOISE = 5e-3, 4e-3  # rad, of arm and camera
NONE = np.zeros((2, 2))


def recordings(
    *, share: float, lasts: bool, pose: float = 0.0, jump: float = 0.0, common: float = 0.0
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Errors and joints of TAKES takes, every third sample a frame that is ``share`` of a step
    late; deviations that last a whole take, or are new at every instant.

    In rad: ``pose`` is the noise of the motion capture, ``jump`` what the number of a frame adds to
    an error, ``common`` the standard deviation of what a take adds.
    """
    rng = np.random.default_rng(4)
    path = np.linspace(0, 1, SAMPLES)[:, None] * [1.0, -2.0]
    joints, angles = [], []
    for number in range(2 * TAKES):
        drawn = rng.normal(scale=DEVIATION, size=(2, SAMPLES, 2))
        d, between = drawn[:, :1] * np.ones((1, SAMPLES, 1)) if lasts else drawn
        between = d if lasts else between
        part = "training" if number < TAKES else "test"
        measured = path + d + rng.normal(scale=pose, size=d.shape)
        t = np.arange(SAMPLES) * STEP
        name = {"take": f"take_{number:03d}", "part": part}
        joints.append(
            pd.DataFrame(name | {"k": np.arange(SAMPLES), "t": t} | spread("q", JOINTS, measured))
        )
        if part == "test":
            k = np.arange(0, SAMPLES - 1, 3)
            own = d[k] if share == 0 else between[k]
            at = path[k] + share * (path[k + 1] - path[k])
            y = at + own * (1 + SLOPE) + rng.normal(scale=NOISE, size=own.shape)
            y += jump * np.sin(k)[:, None] + rng.normal(scale=common, size=2)
            frames = name | {"frame": k, "t": (k + share) * STEP}
            angles.append(pd.DataFrame(frames | spread("q", JOINTS, y)))
    joints = pd.concat(joints, ignore_index=True)
    return errors_of(pd.concat(angles, ignore_index=True), joints), joints


def slopes(frames: str, noise: np.ndarray = NONE, **how: float) -> pd.DataFrame:
    table = error_slopes(deviations(*recordings(**how)), STEP, noise)
    return table[table["frames"] == frames].set_index("joint")


def far(rows: pd.DataFrame) -> np.ndarray:
    return np.abs(rows["slope"].to_numpy() - SLOPE) / rows["standard_error"].to_numpy()


# 4 standard errors: one test in ten thousand fails by chance
def test_the_slope_that_was_put_in_comes_out_whatever_bias_a_frame_has():
    rows = slopes(NEAR_A_SAMPLE, share=0.0, lasts=False, jump=0.05)
    assert np.all(far(rows) < 4)
    assert np.all(rows["standard_error"] < 0.05)
    # control: it is told from no slope
    assert rows.loc["b", "slope"] < -10 * rows.loc["b", "standard_error"]


def test_the_standard_error_knows_what_the_errors_of_a_take_have_in_common():
    common = 8e-3
    rows = slopes(ALL, share=0.5, lasts=True, common=common)
    assert np.all(far(rows) < 4)
    # one pair of deviation and error a take; were frames independent it would be a fifth of this
    expected = common / (DEVIATION * np.sqrt(TAKES))
    np.testing.assert_allclose(rows["standard_error"], expected, rtol=0.35)


def test_the_motion_captures_own_noise_makes_no_slope_once_it_is_known():
    pose = 2e-3
    noise = pose**2 * np.eye(2)
    assert np.all(far(slopes(NEAR_A_SAMPLE, noise, share=0.0, lasts=False, pose=pose)) < 4)
    # control: where it is taken for nothing it does
    assert far(slopes(NEAR_A_SAMPLE, share=0.0, lasts=False, pose=pose))[0] > 4


def test_between_samples_deviations_that_do_not_last_make_a_slope_of_their_own():
    """A camera without any dependence seems to have one: the line between two samples is no
    deviation of the arm at the frame's time.
    """
    rows = slopes(ALL, share=0.5, lasts=False)
    assert rows.loc["a", "slope"] == pytest.approx(-1.0, abs=0.1)
    # controls: neither at a sample nor where they last
    for how in ({"share": 0.0, "lasts": False}, {"share": 0.5, "lasts": True}):
        assert slopes(ALL, **how).loc["a", "slope"] == pytest.approx(0.0, abs=0.1)


def test_where_no_frame_is_near_a_sample_there_is_no_score():
    table = error_slopes(deviations(*recordings(share=0.5, lasts=False)), STEP, NONE)
    assert table[table["frames"] == NEAR_A_SAMPLE]["slope"].isna().all()
    assert slope_scores(table) == {}
    near = error_slopes(deviations(*recordings(share=0.05, lasts=True)), STEP, NONE)
    assert set(slope_scores(near)) == {
        f"depth_error_slope_{joint}{what}" for joint in JOINTS for what in ("", "_standard_error")
    }
