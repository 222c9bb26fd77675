"""The process noise of 80 takes of the laboratory follows none of the motion models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.columns import values
from pipeline.laboratory.dynamics import expose, simulate_take
from pipeline.laboratory.swing import desired_trajectory
from pipeline.models.draws import realize
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.noise import mean_covariance, process_noise
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.law import WishartModel

NO_OFFSET = np.zeros(3)


def perform(arm, trajectory, dynamics, takes: int, seed: int):
    """Recorded poses (takes, M+1, 3), commanded steps (M, 3) and noise (takes, M, 3)."""
    rng = np.random.default_rng(seed)
    v = values(desired_trajectory(arm.chain, trajectory), "v")[:-1] / trajectory.rate
    grid = np.arange(len(v) + 1) / trajectory.rate
    poses = []
    for _ in range(takes):
        t, q, _ = simulate_take(arm.chain, NO_OFFSET, trajectory, dynamics, rng)
        poses.append(expose(t, q, grid, dynamics, rng))
    q = np.array(poses)
    return q, v, process_noise(arm.chain, q, v)


@pytest.fixture(scope="module")
def recorded(arm, trajectory, dynamics):
    """What :func:`perform` returns."""
    return perform(arm, trajectory, dynamics, 80, 12)


@pytest.fixture(scope="module")
def modelled(arm, recorded):
    """Name → (model, free-running poses, noise) of the three models."""
    q, v, noise = recorded
    models = {
        "additive": ScaledModel(mean_covariance(noise)),
        "wishart": WishartModel(0.2),
        "gaussian": GaussianModel(0.12, 25.0),
    }
    rng = np.random.default_rng(13)
    steps = {
        name: realize(model, arm.chain, q, v, "one_step", rng)[0][:, 1:]
        for name, model in models.items()
    }
    nominal = q[:, 1:] - noise
    return {name: (models[name], steps[name] - nominal) for name in models}


def test_its_steps_know_of_each_other_and_the_models_steps_do_not(recorded, modelled):
    _, v, noise = recorded
    pace = np.linalg.norm(v, axis=1)
    moving = pace > 0.95 * pace.max()

    def later(noise: np.ndarray, steps: int) -> tuple[np.ndarray, float]:
        """Correlation of each joint's noise with itself so many steps later, and its band."""
        x, fast = noise - noise.mean(axis=0), moving[steps:] & moving[:-steps]
        pairs = zip(x[:, steps:][:, fast].T, x[:, :-steps][:, fast].T, strict=True)
        correlation = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in pairs]
        return np.array(correlation), 4 / np.sqrt(len(noise) * fast.sum())

    # a deviation lasts longer than a step, and then it swings back: the arm is held by its servo
    for steps, least, sign in ((1, 0.3, 1), (5, 0.1, -1)):
        assert np.all(sign * later(noise, steps)[0] > least)
        for _, drawn in modelled.values():
            correlation, band = later(drawn, steps)
            assert np.all(np.abs(correlation) < band)
            assert band < least


def test_it_does_not_wander_off_and_the_models_do(recorded, modelled):
    def wandering(noise: np.ndarray) -> np.ndarray:
        x = noise - noise.mean(axis=0)
        return x.sum(axis=1).var(axis=0) / x.var(axis=0).sum(axis=0)

    assert np.all(wandering(recorded[2]) < 0.05)
    for _, drawn in modelled.values():
        assert np.all(np.abs(wandering(drawn) - 1) < 4 * np.sqrt(2 / len(drawn)))


def test_it_grows_with_the_speed_neither_not_at_all_nor_in_proportion(
    arm, trajectory, dynamics, recorded, modelled
):
    q, v, noise = recorded
    pace = np.linalg.norm(v, axis=1) / np.linalg.norm(v, axis=1).max()
    slow, fast = (pace > 0.3) & (pace < 0.6), pace > 0.95
    middle = q[:, :-1].mean(axis=0)

    def growth(std: np.ndarray) -> np.ndarray:
        """Std of each joint over speed, slow against fast: 1 where they are in proportion."""
        per_speed = std / pace[:, None].clip(1e-9)
        return per_speed[slow].mean(axis=0) / per_speed[fast].mean(axis=0)

    models = {
        name: growth(np.sqrt(np.diagonal(model.covariance(arm.chain, middle, v), axis1=1, axis2=2)))
        for name, (model, _) in modelled.items()
    }
    assert np.all(models["additive"] > 1.5)
    for model in ("wishart", "gaussian"):
        assert np.all(models[model] > 0.8)
    assert np.all(growth(noise.std(axis=0)) < 0.7)
    # control: a laboratory whose sway grows in proportion to the speed, or not at all, is seen
    for exponent, least in ((1.0, 0.8), (0.0, 1.5)):
        other = replace(dynamics, speed_exponent=exponent)
        assert np.all(growth(perform(arm, trajectory, other, 25, 14)[2].std(axis=0)) > least)
