"""The synthetic arm: without disturbances it does as it is told, each disturbance is what its option says, and all of them together
are none of the motion models that are compared on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kurtosis

from pipeline.errors import ConfigError
from pipeline.motion.additive import AdditiveModel, fit_covariance
from pipeline.motion.gaussian import GaussianModel
from pipeline.motion.noise import process_noise
from pipeline.motion.realizations import realize
from pipeline.motion.wishart import WishartModel
from pipeline.twin.dynamics import expose, session_offset, simulate_take, true_chain
from pipeline.twin.options import DynamicsOptions
from pipeline.twin.trajectory import desired_joints, desired_trajectory

NO_OFFSET = np.zeros(3)


def goal_at(t: np.ndarray, trajectory) -> tuple[np.ndarray, np.ndarray]:
    return desired_joints(np.clip(t, 0.0, trajectory.duration), trajectory)


def deviations(arm, trajectory, quiet: DynamicsOptions, takes: int, rng, **disturbance) -> np.ndarray:
    """(takes, N, 3) what a single kind of disturbance adds to the undisturbed joint angles."""
    _, still = simulate_take(arm.chain, NO_OFFSET, trajectory, quiet, rng)
    disturbed = replace(quiet, **disturbance)
    return np.stack([simulate_take(arm.chain, NO_OFFSET, trajectory, disturbed, rng)[1] for _ in range(takes)]) - still


def lagged_correlation(x: np.ndarray, lag: int) -> float:
    """Of paths along axis 1 of zero mean."""
    return float(np.mean(x[:, lag:] * x[:, :-lag]) / np.mean(x**2))


def test_without_disturbances_the_arm_follows_its_command_up_to_the_servos_step(arm, trajectory, quiet, rng):
    error = []
    for rate in (500.0, 1000.0):
        t, q = simulate_take(arm.chain, NO_OFFSET, trajectory, replace(quiet, rate=rate), rng)
        error.append(np.abs(q - goal_at(t, trajectory)[0]).max())
    # Euler's error: acceleration · step / (2 · gain)
    acceleration = np.abs(np.diff(desired_joints(np.arange(3200) / 1000, trajectory)[1], axis=0)).max() * 1000
    assert error[1] < acceleration / 1000 / 2 / quiet.servo_gain
    assert 1.9 < error[0] / error[1] < 2.1


def test_the_same_stream_gives_the_same_take_and_another_another(arm, trajectory, dynamics):
    takes = [simulate_take(arm.chain, NO_OFFSET, trajectory, dynamics, np.random.default_rng(seed))[1] for seed in (1, 1, 2)]
    assert np.array_equal(takes[0], takes[1])
    assert not np.array_equal(takes[0], takes[2])


def test_a_take_lasts_from_before_the_motion_to_after_it(arm, trajectory, quiet, rng):
    t, q = simulate_take(arm.chain, NO_OFFSET, trajectory, quiet, rng)
    assert t[0] < 0
    assert t[-1] > trajectory.duration
    np.testing.assert_allclose(np.diff(t), 1 / quiet.rate)
    assert q.shape == (len(t), 3)


def test_the_start_scatters_as_stated_and_the_servo_takes_it_back(arm, trajectory, quiet, rng):
    takes = 300
    added = deviations(arm, trajectory, quiet, takes, rng, start_std=4e-3)
    np.testing.assert_allclose(added[:, 0].std(axis=0), 4e-3, rtol=4 / np.sqrt(2 * takes))
    decay = (1 - quiet.servo_gain / quiet.rate) ** np.arange(added.shape[1])
    np.testing.assert_allclose(added, added[:, :1] * decay[:, None], atol=1e-14)


def test_the_speed_error_is_a_share_of_the_speed_with_its_own_memory(arm, trajectory, quiet, rng):
    options = replace(quiet, speed_error_std=0.03, speed_error_time=0.05)
    shares = []
    for _ in range(150):
        t, q = simulate_take(arm.chain, NO_OFFSET, trajectory, options, rng)
        goal, speed = goal_at(t, trajectory)
        told = speed + options.servo_gain * (goal - q)
        fast = (t > 0.65) & (t < 1.0)
        done = np.diff(q, axis=0, append=q[-1:]) * options.rate
        shares.append(done[fast] / told[fast] - 1)
    shares = np.array(shares)
    # 150 takes × 3 joints × 0.35 s, which is 7 correlation times
    band = 4 / np.sqrt(2 * 150 * 3 * 0.35 / (2 * 0.05))
    np.testing.assert_allclose(shares.std(), 0.03, rtol=band)
    for lag in (1, 10, 20):
        correlation = np.mean([lagged_correlation(shares[..., j], lag) for j in range(3)])
        assert abs(correlation - np.exp(-lag / options.rate / 0.05)) < band
        # control: a white error would have forgotten
        assert correlation > band


def test_the_end_effector_sways_as_stated_and_more_the_faster_it_moves(arm, trajectory, quiet, rng):
    std, rest, exponent = np.array([3e-4, 1.5e-3]), 0.02, 2.0
    options = replace(quiet, sway_std=tuple(std), sway_rest=rest, speed_exponent=exponent)
    t, still = simulate_take(arm.chain, NO_OFFSET, trajectory, quiet, rng)
    takes = 150
    added = np.stack([simulate_take(arm.chain, NO_OFFSET, trajectory, options, rng)[1] for _ in range(takes)]) - still
    sway = np.einsum("kij,nkj->nki", arm.chain.jacobian(still), added)
    assert np.abs(sway[..., 2]).max() < 1e-12
    speed = np.linalg.norm(goal_at(t, trajectory)[1], axis=1) / np.linalg.norm(arm.chain.max_speed)
    stated = std * (rest + (1 - rest) * speed**exponent)[:, None]
    unit = sway[..., :2] / stated
    # samples are 5 ms apart and the sway is correlated over 6 ms: a third of them counts
    assert abs(unit.std() - 1) < 4 / np.sqrt(2 * unit.size / 3)
    slow, fast = speed < 0.5 * speed.max(), speed > 0.9 * speed.max()
    for part in (slow, fast):
        assert abs(unit[:, part].std() - 1) < 4 / np.sqrt(2 * unit[:, part].size / 3)
    # control: of one size at every speed it is not
    assert sway[:, slow, 1].std() < 0.3 * sway[:, fast, 1].std()


def test_the_clearance_moves_the_third_joint_alone_anywhere_inside_the_play(arm, trajectory, quiet, rng):
    options = {"clearance": 0.03, "rattle_speed": 0.5, "clearance_time": 2e-3}
    added = deviations(arm, trajectory, quiet, 60, rng, **options)
    assert not added[..., :2].any()
    assert np.abs(added).max() <= 0.03
    t, _ = simulate_take(arm.chain, NO_OFFSET, trajectory, quiet, rng)
    filled = added[:, np.abs(goal_at(t, trajectory)[1][:, 2]) > 0.5, 2] / 0.03
    assert abs(filled.var() - 1 / 3) < 4 * np.sqrt(4 / 45 / filled.size) * 2
    # uniform, and so far from normal
    assert abs(kurtosis(filled, axis=None) + 1.2) < 0.05


def test_the_ripple_is_bounded_and_its_phase_is_drawn_anew_for_every_take(arm, trajectory, quiet, rng):
    added = deviations(arm, trajectory, quiet, 200, rng, encoder_ripple=1e-3)
    assert np.abs(added).max() <= 1e-3 + 1e-15
    # a sine of uniform phase
    np.testing.assert_allclose(added[:, 0].std(axis=0), 1e-3 / np.sqrt(2), rtol=0.15)


def test_the_encoders_zeros_shift_the_whole_take(arm, trajectory, quiet, rng):
    offset = np.array([1e-3, -2e-3, 3e-3])
    (_, moved), (_, still) = (simulate_take(arm.chain, zero, trajectory, quiet, rng) for zero in (offset, NO_OFFSET))
    np.testing.assert_allclose(moved - still, np.tile(offset, (len(still), 1)), atol=1e-15)


def test_a_session_draws_zeros_and_lengths_of_the_stated_size(arm, quiet, rng):
    options, sessions = replace(quiet, encoder_offset_std=2e-3, length_std=3e-4), 1000
    offsets = np.array([session_offset(options, rng) for _ in range(sessions)])
    chains = [true_chain(arm.chain, options, rng) for _ in range(sessions)]
    errors = np.array([chain.lengths for chain in chains]) - arm.chain.lengths
    for drawn, std in ((offsets, 2e-3), (errors, 3e-4)):
        np.testing.assert_allclose(drawn.std(axis=0), std, rtol=4 / np.sqrt(2 * sessions))
        assert np.all(np.abs(drawn.mean(axis=0)) < 4 * std / np.sqrt(sessions))
    # only lengths: the links point as they did
    headings = [np.arctan2(*chain.links.T) for chain in chains]
    np.testing.assert_allclose(headings, np.tile(np.arctan2(*arm.chain.links.T), (sessions, 1)), atol=1e-14)


def test_an_exposure_misses_its_instant_by_the_jitter_and_so_the_angle_by_jitter_times_speed(rng):
    t = np.arange(-50, 3251) / 1000
    q = t[:, None] * np.array([1.0, -0.5, 0.0])
    at = np.full(20_000, 1.0)
    seen = expose(t, q, at, DynamicsOptions(jitter_std=5e-4), rng)
    np.testing.assert_allclose(seen.std(axis=0), [5e-4, 2.5e-4, 0], rtol=4 / np.sqrt(2 * at.size), atol=1e-15)
    exact = expose(t, q, np.array([0.1, 0.7003]), DynamicsOptions(jitter_std=0.0), rng)
    np.testing.assert_allclose(exact[:, 0], [0.1, 0.7003], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "value"), [("sway_std", (1e-3, -1e-3)), ("clearance", -0.1), ("sway_time", 0.0), ("rate", 0.0), ("servo_gain", 1000.0)]
)
def test_options_without_a_meaning_are_refused(dynamics, name, value):
    with pytest.raises(ConfigError, match=rf"twin\.dynamics\.{name}"):
        replace(dynamics, **{name: value})


class TestNoneOfTheModels:
    """The process noise of 80 takes with the dataset's own disturbances, beside that of the three models at the same poses."""

    @pytest.fixture(scope="class")
    @staticmethod
    def recorded(arm, trajectory, dynamics):
        """Poses (takes, M+1, 3), commanded steps (M, 3) and noise (takes, M, 3) of the twin."""
        rng = np.random.default_rng(12)
        v = desired_trajectory(arm.chain, trajectory)[["vx", "vz", "vphi"]].to_numpy()[:-1] / trajectory.rate
        grid = np.arange(len(v) + 1) / trajectory.rate
        takes = [expose(*simulate_take(arm.chain, NO_OFFSET, trajectory, dynamics, rng), grid, dynamics, rng) for _ in range(80)]
        q = np.array(takes)
        return q, v, process_noise(arm.chain, q, v)

    @pytest.fixture(scope="class")
    @staticmethod
    def modelled(arm, recorded):
        """Name → (model, free-running poses, noise) of the three models."""
        q, v, noise = recorded
        models = {"additive": AdditiveModel(fit_covariance(noise)), "wishart": WishartModel(0.2), "gaussian": GaussianModel(0.12, 25.0)}
        rng = np.random.default_rng(13)
        steps = {name: realize(model, arm.chain, q, v, "one_step", rng)[0][:, 1:] for name, model in models.items()}
        nominal = q[:, 1:] - noise
        return {name: (models[name], steps[name] - nominal) for name in models}

    @staticmethod
    def moving(v: np.ndarray) -> np.ndarray:
        pace = np.linalg.norm(v, axis=1)
        return pace > 0.95 * pace.max()

    def centred(self, noise: np.ndarray) -> np.ndarray:
        return noise - noise.mean(axis=0)

    def test_its_steps_know_of_each_other_and_the_models_steps_do_not(self, recorded, modelled):
        _, v, noise = recorded
        fast = self.moving(v)[1:] & self.moving(v)[:-1]

        def neighbours(noise: np.ndarray) -> float:
            x = self.centred(noise)
            return np.mean([np.corrcoef(x[:, 1:][:, fast, j].ravel(), x[:, :-1][:, fast, j].ravel())[0, 1] for j in range(3)])

        # what swung out swings back: the arm is held by its servo
        assert neighbours(noise) < -0.3
        for _, of_model in modelled.values():
            assert abs(neighbours(of_model)) < 4 / np.sqrt(len(noise) * fast.sum())

    def test_it_does_not_wander_off_and_the_models_do(self, recorded, modelled):
        _, _, noise = recorded

        def wandering(noise: np.ndarray) -> np.ndarray:
            x = self.centred(noise)
            return x.sum(axis=1).var(axis=0) / x.var(axis=0).sum(axis=0)

        assert np.all(wandering(noise) < 0.05)
        for _, of_model in modelled.values():
            assert np.all(np.abs(wandering(of_model) - 1) < 4 * np.sqrt(2 / len(noise)))

    def test_its_tails_are_cut_off_and_the_models_are_not(self, recorded, modelled):
        _, v, noise = recorded
        tails = {name: kurtosis(self.centred(of_model)[:, self.moving(v), 2], axis=None) for name, (_, of_model) in modelled.items()}
        band = 4 * np.sqrt(24 / (len(noise) * self.moving(v).sum()))
        # two places inside the play of joint 3, one minus the other: a triangle
        assert kurtosis(self.centred(noise)[:, self.moving(v), 2], axis=None) < -band
        assert abs(tails["additive"]) < band
        assert tails["wishart"] > -band
        assert tails["gaussian"] > -band

    def test_it_grows_with_the_speed_neither_not_at_all_nor_in_proportion(self, arm, recorded, modelled):
        q, v, noise = recorded
        pace = np.linalg.norm(v, axis=1) / np.linalg.norm(v, axis=1).max()
        slow, fast = (pace > 0.3) & (pace < 0.6), pace > 0.95
        middle = q[:, :-1].mean(axis=0)

        def growth(std: np.ndarray) -> np.ndarray:
            """Std of each joint over speed, slow against fast: 1 where they are in proportion."""
            per_speed = std / pace[:, None].clip(1e-9)
            return per_speed[slow].mean(axis=0) / per_speed[fast].mean(axis=0)

        found = growth(noise.std(axis=0))
        models = {
            name: growth(np.sqrt(np.diagonal(model.covariance(arm.chain, middle, v), axis1=1, axis2=2)))
            for name, (model, _) in modelled.items()
        }
        assert np.all(models["additive"] > 1.5)
        for model in ("wishart", "gaussian"):
            assert np.all(models[model] > 0.75)
        assert np.all(found < 0.5)
