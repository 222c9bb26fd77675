"""The synthetic arm: without disturbances it follows its command, and each disturbance is what its
option says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kurtosis

from pipeline.laboratory.dynamics import (
    expose,
    lagged_correlation,
    lagged_noise,
    session_offset,
    simulate_take,
    true_chain,
)
from pipeline.laboratory.options import DynamicsOptions
from pipeline.laboratory.swing import desired_joints

NO_OFFSET = np.zeros(3)


def goal_at(t: np.ndarray, trajectory) -> tuple[np.ndarray, np.ndarray]:
    return desired_joints(np.clip(t, 0.0, trajectory.duration), trajectory)


def deviations(arm, trajectory, quiet, takes: int, rng, **disturbance) -> np.ndarray:
    """(takes, N, 3) what a single kind of disturbance adds to the undisturbed joint angles."""
    still = simulate_take(arm.chain, NO_OFFSET, trajectory, quiet, rng).q
    options = replace(quiet, **disturbance)
    moved = [simulate_take(arm.chain, NO_OFFSET, trajectory, options, rng).q for _ in range(takes)]
    return np.stack(moved) - still


def lagged(x: np.ndarray) -> np.ndarray:
    """Correlation of white noise behind four lags with itself ``x`` lags later, in continuous
    time.
    """
    return (1 + x + 2 * x**2 / 5 + x**3 / 15) * np.exp(-x)


def later(x: np.ndarray, lag: int) -> float:
    """Correlation of paths along axis 1, of zero mean, with themselves ``lag`` steps later."""
    return float(np.mean(x[:, lag:] * x[:, :-lag]) / np.mean(x**2))


@pytest.mark.parametrize(("steps_per_lag", "paths"), [(13.5, 4000), (540.0, 600)])
def test_lagged_noise_has_variance_one_and_the_correlation_of_four_lags(steps_per_lag, paths, rng):
    steps = np.round(np.array([0.5, 1.0, 2.0]) * steps_per_lag).astype(int)
    noise = lagged_noise((paths, steps[-1] + 1), steps_per_lag, rng)
    band, x = 4.5 * np.sqrt(2 / paths), steps / steps_per_lag
    for end in (0, -1):  # stationary from the first sample on
        assert abs(np.mean(noise[:, end] ** 2) - 1) < band
    # E(x(t + s) − x(t))² = 2(1 − ρ(s)), which tells short times apart
    moved = np.mean((noise[:, steps] - noise[:, :1]) ** 2, axis=0) / 2
    assert np.all(np.abs(moved / (1 - lagged(x)) - 1) < band)
    np.testing.assert_allclose(
        lagged_correlation(steps, steps_per_lag), lagged(x), atol=0.01 / steps_per_lag
    )
    assert lagged_correlation(np.array(10**6), steps_per_lag) == 0.0
    # controls: one lag fewer, and a single one
    for other in ((1 + x + x**2 / 3) * np.exp(-x), np.exp(-x)):
        assert np.all(np.abs(moved[:2] / (1 - other[:2]) - 1) > band)


def test_without_disturbances_the_arm_follows_its_command_up_to_the_servos_step(
    arm, trajectory, quiet, rng
):
    error = []
    for rate in (500.0, 1000.0):
        t, q, _ = simulate_take(arm.chain, NO_OFFSET, trajectory, replace(quiet, rate=rate), rng)
        error.append(np.abs(q - goal_at(t, trajectory)[0]).max())
        assert t[0] < 0 and t[-1] > trajectory.duration
    # Euler's error: acceleration · step / (2 · gain)
    acceleration = (
        np.abs(np.diff(desired_joints(np.arange(3200) / 1000, trajectory)[1], axis=0)).max() * 1000
    )
    assert error[1] < acceleration / 1000 / 2 / quiet.servo_gain
    assert 1.9 < error[0] / error[1] < 2.1


@pytest.mark.slow
def test_the_start_scatters_as_stated_and_the_servo_takes_it_back(arm, trajectory, quiet, rng):
    takes = 300
    added = deviations(arm, trajectory, quiet, takes, rng, start_std=4e-3)
    np.testing.assert_allclose(added[:, 0].std(axis=0), 4e-3, rtol=4 / np.sqrt(2 * takes))
    decay = (1 - quiet.servo_gain / quiet.rate) ** np.arange(added.shape[1])
    np.testing.assert_allclose(added, added[:, :1] * decay[:, None], atol=1e-14)


def test_the_speed_error_is_a_share_of_the_speed_with_its_own_memory(arm, trajectory, quiet, rng):
    options = replace(quiet, speed_error_std=0.03, speed_error_time=0.022)
    shares = []
    for _ in range(150):
        t, q, _ = simulate_take(arm.chain, NO_OFFSET, trajectory, options, rng)
        goal, speed = goal_at(t, trajectory)
        commanded = speed + options.servo_gain * (goal - q)
        fast = (t > 0.65) & (t < 1.0)
        done = np.diff(q, axis=0, append=q[-1:]) * options.rate
        shares.append(done[fast] / commanded[fast] - 1)
    shares = np.array(shares)
    # 150 takes × 3 joints × 0.35 s; ∫ρ² is 4.29 lags
    band = 4 / np.sqrt(2 * 150 * 3 * 0.35 / (4.29 * 0.022))
    np.testing.assert_allclose(shares.std(), 0.03, rtol=band)
    for lag in (1, 5, 10):
        correlation = np.mean([later(shares[..., j], lag) for j in range(3)])
        x = lag / options.rate / options.speed_error_time
        assert abs(correlation - lagged(x)) < band
        # control: behind a single lag it would have forgotten more
        assert correlation - np.exp(-x) > band


def test_the_end_effector_sways_as_stated_and_more_the_faster_it_moves(arm, trajectory, quiet, rng):
    std, rest, exponent = np.array([3e-4, 1.5e-3, 0.03]), 0.02, 2.0
    options = replace(quiet, sway_std=tuple(std), sway_rest=rest, speed_exponent=exponent)
    t, still, _ = simulate_take(arm.chain, NO_OFFSET, trajectory, quiet, rng)
    takes = [simulate_take(arm.chain, NO_OFFSET, trajectory, options, rng)[1] for _ in range(150)]
    added = np.stack(takes) - still
    sway = np.einsum("kij,nkj->nki", arm.chain.jacobian(still), added)
    speed = np.linalg.norm(goal_at(t, trajectory)[1], axis=1) / np.linalg.norm(arm.chain.max_speed)
    stated = std * (rest + (1 - rest) * speed**exponent)[:, None]
    unit = sway / stated
    slow, fast = speed < 0.5 * speed.max(), speed > 0.9 * speed.max()
    for part in (slow | ~slow, slow, fast):
        # samples are 5 ms apart and ∫ρ² is 4.29 lags of 13.5 ms: a twelfth of them counts
        band = 4 / np.sqrt(2 * unit[:, part, 0].size / 12)
        assert np.all(np.abs(unit[:, part].std(axis=(0, 1)) - 1) < band)
    # control: of one size at every speed it is not
    sizes = [sway[:, part].std(axis=(0, 1)) for part in (slow, fast)]
    assert np.all(sizes[0] < 0.3 * sizes[1])


def test_the_clearance_moves_the_third_joint_alone_anywhere_inside_the_play(
    arm, trajectory, quiet, rng
):
    options = {"clearance": 0.03, "rattle_speed": 0.5, "clearance_time": 2e-3}
    added = deviations(arm, trajectory, quiet, 60, rng, **options)
    assert not added[..., :2].any()
    assert np.abs(added).max() <= 0.03
    t, _, _ = simulate_take(arm.chain, NO_OFFSET, trajectory, quiet, rng)
    filled = added[:, np.abs(goal_at(t, trajectory)[1][:, 2]) > 0.5, 2] / 0.03
    assert abs(filled.var() - 1 / 3) < 4 * np.sqrt(4 / 45 / filled.size) * 2
    # uniform, and so far from normal
    assert abs(kurtosis(filled, axis=None) + 1.2) < 0.05


def test_the_ripple_is_bounded_and_its_phase_is_drawn_anew_for_every_take(
    arm, trajectory, quiet, rng
):
    added = deviations(arm, trajectory, quiet, 200, rng, encoder_ripple=1e-3)
    assert np.abs(added).max() <= 1e-3 + 1e-15
    # a sine of uniform phase
    np.testing.assert_allclose(added[:, 0].std(axis=0), 1e-3 / np.sqrt(2), rtol=0.15)


def test_the_encoders_zeros_shift_the_whole_take(arm, trajectory, quiet, rng):
    offset = np.array([1e-3, -2e-3, 3e-3])
    moved, still = (
        simulate_take(arm.chain, zero, trajectory, quiet, rng).q for zero in (offset, NO_OFFSET)
    )
    np.testing.assert_allclose(moved - still, np.tile(offset, (len(still), 1)), atol=1e-15)


def test_a_session_draws_zeros_and_lengths_of_the_stated_size(arm, quiet, rng):
    options, sessions = replace(quiet, encoder_offset_std=2e-3, length_std=3e-4), 1000
    offsets = np.array([session_offset(options, 3, rng) for _ in range(sessions)])
    chains = [true_chain(arm.chain, options, rng) for _ in range(sessions)]
    errors = np.array([chain.lengths for chain in chains]) - arm.chain.lengths
    for drawn, std in ((offsets, 2e-3), (errors, 3e-4)):
        np.testing.assert_allclose(drawn.std(axis=0), std, rtol=4 / np.sqrt(2 * sessions))
        assert np.all(np.abs(drawn.mean(axis=0)) < 4 * std / np.sqrt(sessions))
    # only lengths: the links point as they did
    headings = [np.arctan2(*chain.links.T) for chain in chains]
    np.testing.assert_allclose(
        headings, np.tile(np.arctan2(*arm.chain.links.T), (sessions, 1)), atol=1e-14
    )


def test_an_exposure_misses_its_instant_by_the_jitter_and_so_the_angle_by_jitter_times_speed(rng):
    t = np.arange(-50, 3251) / 1000
    q = t[:, None] * np.array([1.0, -0.5, 0.0])
    at = np.full(20_000, 1.0)
    exposed = expose(t, q, at, DynamicsOptions(jitter_std=5e-4), rng)
    np.testing.assert_allclose(
        exposed.std(axis=0), [5e-4, 2.5e-4, 0], rtol=4 / np.sqrt(2 * at.size), atol=1e-15
    )
    exact = expose(t, q, np.array([0.1, 0.7003]), DynamicsOptions(jitter_std=0.0), rng)
    np.testing.assert_allclose(exact[:, 0], [0.1, 0.7003], atol=1e-12)
