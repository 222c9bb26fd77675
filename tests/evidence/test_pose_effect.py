"""The exponent of the pose is recovered, noise that knows only the speed has none, and a motion
that cannot tell says so.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from pipeline.core.rng import stream
from pipeline.evidence.pose import noise_parts, pose_table
from pipeline.models.joint_error.samples import JointRun
from pipeline.models.model import frobenius
from pipeline.statistics.curves import POWER
from pipeline.statistics.pose_effect import pose_effect, windows_of

MOTIONS = 8
STEPS = 400


def motions(
    exponent: float,
    swing: float,
    rng: np.random.Generator,
    tails: float = np.inf,
):
    """Noise proportional to the speed and to a power of a pose quantity."""
    t = np.linspace(0, 2 * np.pi, STEPS)
    listed = []
    for number in range(MOTIONS):
        speeds = [np.sin(t + number), np.sin(2 * t) + 1.2, np.zeros(STEPS)]
        dq = 1e-3 * np.stack(speeds, axis=1)
        wave = np.exp(swing * np.sin(3 * t + 0.7 * number))
        x = np.stack([wave] * 3, axis=1)
        unit = rng.standard_normal((STEPS, 3))
        if np.isfinite(tails):
            unit = rng.standard_t(tails, (STEPS, 3))
        listed.append((0.05 * np.abs(dq) * x**exponent * unit, dq, x))
    return listed


@pytest.mark.slow
@pytest.mark.parametrize("tails", [np.inf, 3.0])
@pytest.mark.parametrize("exponent", [0.0, 1.0])
def test_the_exponent_is_recovered_and_told_from_the_other(exponent, tails):
    inside = []
    for seed in range(20):
        rng = default_rng(seed)
        effect = pose_effect(windows_of(motions(exponent, 0.5, rng, tails)), rng)
        low = effect.exponent.low
        high = effect.exponent.high
        inside.append(low <= exponent <= high)
        assert effect.power > POWER
        assert not low <= 1 - exponent <= high
    assert np.mean(inside) >= 0.8


def test_a_motion_through_equal_poses_cannot_tell_and_names_the_range_that_would():
    rng = default_rng(1)
    narrow = pose_effect(windows_of(motions(1.0, 0.02, rng)), rng)
    assert narrow.power < POWER
    assert narrow.exponent.low < 0 < narrow.exponent.high
    assert narrow.needed > narrow.spread

    rng = default_rng(2)
    wide = pose_effect(windows_of(motions(1.0, 2.5 * narrow.needed, rng)), rng)
    assert wide.power > POWER


def test_blocks_stand_for_motions_where_there_is_one_and_too_few_windows_tell_nothing():
    rng = default_rng(3)
    joined = [*map(np.concatenate, zip(*motions(1.0, 0.5, rng), strict=True))]
    start = [values[:50] for values in joined]

    effect = pose_effect(windows_of([joined]), rng)

    assert effect.groups == 8
    assert effect.exponent.low > 0
    assert pose_effect(windows_of([start]), rng) is None


@pytest.fixture
def runs_of_arm(chain) -> list[JointRun]:
    """Runs whose noise grows with ‖J⁻¹‖; the elbow passes through straight, near which the norm
    changes within a window.
    """
    rng = default_rng(5)
    zero = np.zeros(3)
    t = np.linspace(0, 2 * np.pi, 801)
    runs = []
    for number in range(4):
        phase = number * np.pi / 4
        waves = np.sin(np.outer(t, [1, 3, 2]) + phase)
        command = [0.3, 1.0, -0.4] + [0.5, 1.5, 0.4] * waves

        is_singular = chain.singular(command)[:, None]
        regular = np.where(is_singular, 1.5, command)
        norms = frobenius(chain.inverse_jacobian(regular[:-1]))
        steps = np.diff(command, axis=0)
        std = 1e-4 * np.abs(steps) * norms[:, None]
        noise = std * rng.standard_normal(steps.shape)
        measured = command + np.vstack([zero, np.cumsum(noise, axis=0)])

        recorded = "r", 100.0, command, measured, ("a", "b", "c")
        runs.append(JointRun(*recorded, zero, zero, None, f"{number}"))
    return runs


def test_the_table_has_the_exponent_of_noise_that_grows_with_the_norm_but_for_singular_poses(
    chain,
    runs_of_arm,
):
    (row,) = pose_table(runs_of_arm, chain, {}, partial(stream, 5)).itertuples()
    assert row.groups == 4
    assert 0.5 < row.low < 1 < row.high


def test_too_few_windows_are_numbers_without_rows(chain, runs_of_arm):
    run = runs_of_arm[0]
    start = replace(run, command=run.command[:30], measured=run.measured[:30])
    table = pose_table([start], chain, {}, partial(stream, 5))
    assert table.empty
    assert {*table.dtypes[2:].astype(str)} == {"float64", "int64"}


def test_noise_parts_are_what_repeats_and_what_differs_with_the_variance_of_one_run():
    rng = default_rng(9)
    repeated = np.sin(np.linspace(0, 9, 5000))[:, None] * [3e-3, 1e-3]
    runs = [repeated + rng.normal(0.0, 1e-4, (5000 + n, 2))[:5000] for n in range(4)]
    on_time = [np.zeros(2)] * 4
    parts = noise_parts(runs, on_time)

    assert [*parts] == ["all", "differing", "repeated"]
    assert_allclose(parts["repeated"][0], repeated, atol=3e-4)
    assert np.std(parts["differing"]) == pytest.approx(1e-4, rel=0.03)

    # nothing repeats in a single run
    assert [*noise_parts(runs[:1], on_time[:1])] == ["all"]


def test_an_error_that_repeats_later_in_a_repetition_does_not_differ():
    time = np.linspace(0, 9, 500)
    late = np.array([1.5, 0.5])  # samples
    delayed = time[:, None] - late * (time[1] - time[0])
    first = np.sin(time)[:, None] * [3e-3, 1e-3]
    second = np.sin(delayed) * [3e-3, 1e-3]
    aligned = noise_parts([first, second], [np.zeros(2), late])

    assert np.abs(aligned["differing"]).max() < 1e-7

    # control: without the shift the repeated error differs
    unaligned = noise_parts([first, second], [np.zeros(2), np.zeros(2)])
    assert np.abs(unaligned["differing"]).max() > 1e-5
