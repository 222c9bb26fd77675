"""Standard deviations over time: a true model passes the test and has the least error, constant
noise does not, and where neither can be told the power says so.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.statistics.curves import (
    HALF_EXPLAINED,
    NO_NOISE,
    POWER,
    RECOGNISED,
    ModelledNoise,
    constant_noise_variation,
    correlation,
    following_tests,
    mean_error_comparison,
    spread_comparison,
    std_scores,
)

STEPS, DRAWS, REPEATS, TAKES = 160, 1000, 150, 40
JOINTS = ("elbow", "wrist")
NOT_STEADY = np.zeros(STEPS, dtype=bool)
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


def model_of(std: np.ndarray, draws: np.ndarray) -> ModelledNoise:
    return ModelledNoise(std**2, np.zeros(std.shape[1]), draws, draws)


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


@pytest.mark.parametrize("takes", [4, 50])
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
    rows = following_tests(model_of(std, draws), noise, NOT_STEADY, JOINTS, rng)
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
    rng, std = np.random.default_rng(1), curve(0.4)
    std[:, 0] = 1e-3
    noise = takes_of(std, "normal", 0.0, 20, rng)
    rows = following_tests(model_of(std, noise), noise, np.arange(STEPS) < 2, JOINTS, rng)
    assert rows[["joint", "steps"]].to_numpy().tolist() == [["wrist", "all"]]


@pytest.mark.parametrize("takes", [4, 50])
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


def test_what_follows_the_ramps_alone_does_not_follow_at_constant_speed():
    steps = np.arange(60)
    ramp, steady = np.minimum(steps, 20.0), steps > 20
    std = {"recorded": (ramp + np.sin(steps))[:, None], "wishart": (ramp - np.sin(steps))[:, None]}
    std["none"] = np.full((60, 1), np.nan)
    scores = std_scores(std, {}, ["hip"], steady)
    assert scores["wishart_std_hip_correlation_with_recorded"] > 0.9
    assert scores["wishart_std_hip_correlation_with_recorded_at_constant_speed"] < -0.9
    assert not any(name.startswith("none") for name in scores)


RAMP = np.linspace(0.2, 2.0, STEPS)[:, None] * np.array([1.0, 0.5])
FLAT = np.sqrt(np.mean(RAMP**2, axis=0)) * np.ones((STEPS, 2))
MEASUREMENT = np.full(2, 0.01)


def noise_of(std: np.ndarray, takes: int, seed: int) -> np.ndarray:
    return std * np.random.default_rng(seed).normal(size=(takes, *std.shape))


@pytest.mark.parametrize("level", [0.1, 10.0])
def test_errors_are_compared_at_one_level_and_the_true_model_has_the_least(level):
    noise = noise_of(np.sqrt(RAMP**2 + MEASUREMENT), TAKES, 2)
    motion = {"flat": level * FLAT**2, "ramp": RAMP**2, "same": 2 * FLAT**2}
    motion["even"] = level * np.mean(RAMP**2, 1)[:, None] * np.ones(2)
    table = spread_comparison(motion, MEASUREMENT, noise, JOINTS)
    rows = table.set_index(["model", "rival", "joint", "rival_joint"])
    ramp = rows.loc[("ramp", "flat", "elbow", "elbow")]
    assert ramp["high"] < 0 and ramp["error"] < 0.2 < ramp["rival_error"]
    assert rows.loc[("ramp", NO_NOISE, "elbow", "elbow"), "rival_error"] == 1
    # a model with one variance for all joints has the greater error in the joint with the least
    assert rows.loc[("even", "even", "elbow", "wrist"), "high"] < 0
    same = rows.loc[("same", "flat", "elbow", "elbow"), ["difference", "low", "high"]]
    np.testing.assert_allclose(same.to_numpy(float), 0, atol=1e-12)
    # the first model has no difference to itself, nor the last joint
    assert ("flat", "flat", "elbow", "elbow") not in rows.index
    assert ("ramp", "ramp", "wrist", "wrist") not in rows.index


def test_the_error_of_a_biased_mean_varies_more_and_an_order_by_chance_is_not_decided():
    noise, course = noise_of(FLAT, TAKES, 7), np.sin(np.linspace(0, 3, STEPS))[:, None]
    error = {"plain": noise, "again": noise_of(FLAT, TAKES, 8), "biased": noise + course}
    rows = mean_error_comparison(error).set_index(["model", "rival"])
    assert rows.loc[("plain", "biased"), "high"] < 0 < rows.loc[("biased", "plain"), "low"]
    chance = rows.loc[("plain", "again")]
    assert chance["low"] < 0 < chance["high"]


def test_the_interval_of_a_difference_covers_its_mean_about_as_often_as_it_says():
    """Between two models of other courses over time, for as few as four takes."""
    motion, rows = {"flat": FLAT**2, "ramp": RAMP**2}, []
    for seed in range(80):
        table = spread_comparison(motion, MEASUREMENT, noise_of(FLAT, 4, seed), JOINTS)
        rows.append(table.query("model == 'ramp' and rival == 'flat' and joint == 'elbow'").iloc[0])
    middle = np.mean([row["difference"] for row in rows])
    assert np.mean([row["low"] <= middle <= row["high"] for row in rows]) > 0.85
