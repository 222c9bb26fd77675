"""Clocks: what a wrong one does to the noise that is estimated by it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.columns import spread
from pipeline.studies.sensitivity.clocks import CLOCKS, camera_on, retimed

FRAME, STEP = 0.03, 0.01
SPEED = np.array([0.5, -1.0, 2.0])  # rad/s
JOINTS = ("one", "two", "three")
MEAN = [f"b:{joint}" for joint in JOINTS]
VARIANCE = [f"r:{joint}:{joint}" for joint in JOINTS]


def recordings(deviation: float):
    """Angles of 8 takes that move at a constant speed, the motion capture's, and clock offsets that
    differ by ``deviation`` in s.
    """
    rng = np.random.default_rng(3)
    angles, joints = [], []
    offsets = pd.Series(0.1 + deviation * rng.standard_normal(8), [f"test_{n}" for n in range(8)])
    for take in offsets.index:
        t = np.arange(101) * STEP
        joints.append(
            pd.DataFrame({"take": take, "t": t} | spread("q", JOINTS, t[:, None] * SPEED))
        )
        observed = 0.3 + np.arange(15) * FRAME
        q = SPEED * observed[:, None] + 0.01 + 1e-3 * rng.standard_normal((15, 3))
        angles.append(
            pd.DataFrame(
                {"take": take, "frame": np.arange(15), "t": observed} | spread("q", JOINTS, q)
            )
        )
    return pd.concat(angles, ignore_index=True), pd.concat(joints, ignore_index=True), offsets


def noise_on(clock: str, deviation: float) -> pd.DataFrame:
    noise = camera_on(clock, *recordings(deviation), frame=FRAME, step=STEP, window=1).noise
    return noise[noise["take"] == "none"]


def test_a_clock_that_is_off_alike_in_every_take_goes_into_the_bias_alone():
    right, late = noise_on("aligned", 0.0), noise_on("a frame late", 0.0)
    np.testing.assert_allclose(
        late[MEAN] - right[MEAN], np.broadcast_to(-SPEED * FRAME, (15, 3)), atol=1e-12
    )
    np.testing.assert_allclose(late[VARIANCE], right[VARIANCE])


def test_a_clock_that_is_off_otherwise_in_every_take_widens_the_noise_too():
    # control: offsets that are all alike do not
    alike = noise_on("not aligned", 0.0)[VARIANCE].mean()
    np.testing.assert_allclose(alike, noise_on("aligned", 0.0)[VARIANCE].mean())
    widened = noise_on("not aligned", 0.02)[VARIANCE].mean() - alike
    variance = recordings(0.02)[2].var()
    np.testing.assert_allclose(widened, SPEED**2 * variance, rtol=0.1)


def test_the_clocks_are_what_they_are_called():
    angles, _, offsets = recordings(0.02)
    times = {
        clock: retimed(angles, clock, offsets, FRAME, STEP)["t"].to_numpy() for clock in CLOCKS
    }
    np.testing.assert_array_equal(times["aligned"], angles["t"])
    np.testing.assert_allclose(times["not aligned"] + angles["take"].map(offsets), times["aligned"])
    np.testing.assert_allclose(times["a frame late"] - times["a frame early"], 2 * FRAME)
    shifted = retimed(angles.assign(t=angles["t"] + 0.0047), "nearest step", offsets, FRAME, STEP)[
        "t"
    ].to_numpy()
    np.testing.assert_allclose(shifted, times["aligned"], atol=1e-12)
    # and no angle is touched
    pd.testing.assert_frame_equal(
        retimed(angles, "a frame late", offsets, FRAME, STEP).drop(columns="t"),
        angles.drop(columns="t"),
    )


def test_every_take_is_measured_with_the_noise_of_its_clock():
    camera = camera_on("a frame late", *recordings(0.0), frame=FRAME, step=STEP, window=1)
    assert list(camera.takes) == [f"test_{n}" for n in range(8)]
    observed = camera.takes["test_2"]
    # what the clock shifts, the bias takes back: the corrected angle is the right one at the wrong
    # time
    assert (observed.y - observed.bias - SPEED * observed.t[:, None]) == pytest.approx(
        np.zeros((15, 3)), abs=5e-3
    )
    uncorrected = observed.y - 0.01 - SPEED * observed.t[:, None]
    assert np.abs(uncorrected).mean(axis=0) == pytest.approx(np.abs(SPEED) * FRAME, rel=0.05)
