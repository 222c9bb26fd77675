"""The test of whether a standard deviation follows a model's: the model itself passes, constant
noise does not, and where neither can be told the power says so.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.statistics.agreement import correlation
from pipeline.statistics.following import (
    HALF_EXPLAINED,
    POWER,
    RECOGNISED,
    constant_noise_variation,
    following_tests,
)

STEPS, DRAWS, REPEATS = 160, 1000, 150
JOINTS = ("elbow", "wrist")
ALL = {"all": np.ones(STEPS, dtype=bool)}
LAWS = {
    "normal": lambda rng, size: rng.standard_normal(size),
    "heavy-tailed": lambda rng, size: rng.standard_t(5, size) * np.sqrt(0.6),
}


def curve(variation: float) -> np.ndarray:
    """(STEPS, 2) standard deviations of so much variation over their mean."""
    wave = 1 + np.sqrt(2) * variation * np.sin(np.linspace(0, 4 * np.pi, STEPS, endpoint=False))
    return 1e-3 * np.stack([wave, wave[::-1]], axis=1)


def takes_of(std: np.ndarray, law: str, share: float, takes: int, rng) -> np.ndarray:
    """(takes, STEPS, 2) noise, correlated from step to step by ``share``."""
    unit = LAWS[law](rng, (takes, *std.shape))
    for k in range(1, STEPS):
        unit[:, k] = share * unit[:, k - 1] + np.sqrt(1 - share**2) * unit[:, k]
    return std * unit


def share_above(limits: np.ndarray, std: np.ndarray, truth: np.ndarray, *law) -> np.ndarray:
    """Shares of new recordings of the ``truth`` whose correlation with ``std`` reaches the
    ``limits`` in each joint, and in all at once.
    """
    above = []
    for _ in range(REPEATS):
        recorded = takes_of(truth, *law).std(axis=0, ddof=1)
        found = [correlation(std[:, j], recorded[:, j]) for j in range(len(JOINTS))]
        above.append(np.array(found) >= limits)
    return np.array([*np.mean(above, axis=0), np.all(above, axis=1).mean()])


@pytest.mark.parametrize("takes", [4, 100])
@pytest.mark.parametrize("variation", [0.05, 0.4])
@pytest.mark.parametrize(
    ("law", "share"), [("normal", 0.0), ("normal", 0.7), ("heavy-tailed", 0.0)]
)
def test_a_true_model_passes_in_all_joints_and_constant_noise_fails_as_often_as_the_power_says(
    takes, variation, law, share
):
    std, rng = curve(variation), np.random.default_rng(takes)
    flat = np.sqrt(np.mean(std**2, axis=0)) * np.ones_like(std)
    draws = std * LAWS[law](rng, (DRAWS, *std.shape))
    noise = takes_of(std, law, share, takes, rng)
    rows = following_tests(std, draws, noise, ALL, JOINTS, rng)
    limits = rows["limit"].to_numpy()
    assert limits.max() <= HALF_EXPLAINED
    error = np.sqrt(RECOGNISED * (1 - RECOGNISED) / REPEATS)
    own = share_above(limits, std, std, law, share, takes, rng)
    assert own[-1] >= RECOGNISED - 4 * error
    constant = share_above(limits, std, flat, law, share, takes, rng)
    assert 1 - constant[:-1] == pytest.approx(rows["power"].to_numpy(), abs=0.15)
    # control: a fixed limit of √½ would fail the true model where nothing can be told
    if takes == 4 and variation == 0.05:
        assert rows["power"].max() < POWER
        assert share_above(HALF_EXPLAINED, std, std, law, share, takes, rng)[-1] < 0.1
    elif variation == 0.4 and share == 0:
        assert rows["power"].min() > POWER


def test_constant_deviations_and_too_few_steps_have_no_test():
    rng = np.random.default_rng(1)
    std = curve(0.4)
    std[:, 0] = 1e-3
    noise = takes_of(std, "normal", 0.0, 20, rng)
    few = ALL | {"few": np.arange(STEPS) < 2}
    rows = following_tests(std, noise, noise, few, JOINTS, rng)
    assert rows[["joint", "steps"]].to_numpy().tolist() == [["wrist", "all"]]


@pytest.mark.parametrize("takes", [4, 100])
@pytest.mark.parametrize("law", LAWS)
def test_constant_noise_varies_less_than_its_limit_and_noise_that_comes_and_goes_more(takes, law):
    rng, flat = np.random.default_rng(takes), 1e-3 * np.ones((STEPS, 2))
    inside = []
    for _ in range(8):
        noise = takes_of(flat, law, 0.3, takes, rng)
        curves = noise.std(axis=0, ddof=1)
        found = curves.std(axis=0) / curves.mean(axis=0)
        inside.append((found <= constant_noise_variation(noise, rng)).all())
    assert np.mean(inside) >= 0.6
    curves = takes_of(curve(0.6), "normal", 0.3, 100, rng)
    found = curves.std(axis=0).std(axis=0) / curves.std(axis=0).mean(axis=0)
    assert (found > constant_noise_variation(curves, rng)).all()
