"""The controller's log: the command, and what the encoders read of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.laboratory.dynamics import simulate_take
from pipeline.laboratory.encoders import log_joints
from pipeline.laboratory.options import EncoderOptions
from pipeline.laboratory.swing import desired_joints

OPTIONS = EncoderOptions(rate=250.0, resolution=1e-3)


def test_the_log_has_its_own_rate_and_the_command_is_exact(arm, trajectory, quiet, rng):
    swing = simulate_take(arm.chain, np.zeros(3), trajectory, quiet, rng)
    t, signals = log_joints(swing, trajectory, OPTIONS)
    np.testing.assert_allclose(t, np.arange(801) / 250, atol=1e-12)
    assert np.array_equal(signals["target"], desired_joints(t, trajectory)[0])


def test_encoders_read_to_their_resolution_and_know_nothing_of_their_zeros(
    arm, trajectory, quiet, rng
):
    offset = np.array([2e-3, -3e-3, 5e-3])
    swing = simulate_take(arm.chain, offset, trajectory, quiet, rng)
    np.testing.assert_allclose(swing.q - swing.servo, np.tile(offset, (len(swing.t), 1)))
    t, signals = log_joints(swing, trajectory, OPTIONS)
    actual = signals["actual"] / OPTIONS.resolution
    np.testing.assert_allclose(actual, np.round(actual), atol=1e-9)
    servo = np.stack([np.interp(t, swing.t, joint) for joint in swing.servo.T], axis=1)
    error = signals["actual"] - servo
    assert np.abs(error).max() <= OPTIONS.resolution / 2 * (1 + 1e-9)
    # rounding is uniform where the arm moves
    moving = np.abs(np.gradient(servo, axis=0)).min(axis=1) > 1e-4
    assert error[moving].std() == pytest.approx(1e-3 / np.sqrt(12), rel=0.05)
    # control: against where the arm is they are off by their zeros
    true = np.stack([np.interp(t, swing.t, joint) for joint in swing.q.T], axis=1)
    np.testing.assert_allclose((true - signals["actual"]).mean(axis=0), offset, atol=3e-4)


def test_what_happens_behind_the_gears_no_encoder_reads(arm, trajectory, quiet):
    logs = []
    for clearance in (0.0, 0.03):
        dynamics = replace(quiet, clearance=clearance)
        rng = np.random.default_rng(3)
        swing = simulate_take(arm.chain, np.zeros(3), trajectory, dynamics, rng)
        logs.append((swing.q, log_joints(swing, trajectory, OPTIONS)[1]["actual"]))
    assert np.array_equal(logs[0][1], logs[1][1])
    assert np.abs(logs[0][0] - logs[1][0]).max() > 1e-3


@pytest.mark.parametrize("bad", [{"rate": 0.0}, {"resolution": 0.0}])
def test_encoders_without_a_meaning_are_refused(bad):
    with pytest.raises(ConfigError, match=r"laboratory\.encoders"):
        replace(OPTIONS, **bad)
