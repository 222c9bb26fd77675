"""Each principle is kept where its number is within the limit, and not beyond."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.studies.principles import rows
from pipeline.studies.principles.motion import Moved


def arm(covariance: np.ndarray, deviation: np.ndarray | None = None) -> Moved:
    return Moved(covariance, deviation, np.zeros(0), np.zeros(0))


def kept(principles: list[rows.Row]) -> list[bool]:
    return [row[-1] for row in principles]


def test_what_the_others_leave_of_the_last_joint_is_the_clearances(stated):
    rng = np.random.default_rng(1)
    root = rng.standard_normal((2, 2))
    first, weights, own = root @ root.T, np.array([0.7, -1.3]), 0.4
    cross = first @ weights
    last = weights @ first @ weights + own
    covariance = np.block([[first, cross[:, None]], [cross[None], np.array([[last]])]])
    assert rows.left_for_clearance(covariance) == pytest.approx(own / last)
    assert rows.left_for_clearance(stated.covariance) == pytest.approx(0.46, abs=0.005)


def test_the_published_noise_keeps_its_own_principles_and_another_does_not(stated):
    assert all(kept(rows.noise_rows(arm(stated.covariance), stated)))
    # uncorrelated, twice the size, and all of joint 3 left to the clearance
    other = rows.noise_rows(arm(4 * np.diag(np.diag(stated.covariance))), stated)
    assert not any(kept(other))
    # the size of one joint alone
    size = np.diag([1.0, 1.6, 1.0])
    assert kept(rows.noise_rows(arm(size @ stated.covariance @ size), stated)) == (
        [True] * 3 + [True, False, True] + [True]
    )


def test_a_path_below_its_speed_or_beyond_the_bound_does_not_keep_them(chain, motion):
    assert kept(rows.path_rows(chain, motion, 18.0)) == [True, True, True]
    slow = replace(motion, duration=2 * motion.duration)
    assert kept(rows.path_rows(chain, slow, 18.0)) == [False, True, True]
    assert kept(rows.path_rows(chain, motion, 15.0)) == [True, False, True]


def test_the_path_is_among_the_best_of_those_drawn():
    others = np.linspace(0.01, 1.0, 100).tolist()
    assert [row[4] for row in rows.choice_rows(0.025, others)] == [100.0, 0.02]
    assert kept(rows.choice_rows(0.025, others)) == [True, True]
    assert kept(rows.choice_rows(0.035, others)) == [True, False]


def test_the_motors_bear_the_mean_and_one_standard_deviation():
    mean, std = np.array([[1.0, -1.0], [-3.0, 1.0]]), np.array([[1.0, 1.0], [1.0, 2.0]])
    needed = rows.drive_rows(["a", "b"], np.array([3.0, 2.4]), mean, std)
    assert [(row[3], row[4], row[5]) for row in needed] == [(3.0, 3.0, True), (2.4, 2.5, False)]


def test_what_is_left_of_a_deviation_is_told_a_step_and_a_frame_later():
    keep, takes = 0.8, 400
    rng = np.random.default_rng(2)
    deviation = np.empty((takes, 100, 2))
    deviation[:, 0] = rng.standard_normal((takes, 2))
    for k in range(99):
        fresh = np.sqrt(1 - keep**2) * rng.standard_normal((takes, 2))
        deviation[:, k + 1] = keep * deviation[:, k] + fresh
    left = rows.lasting_rows(["a", "b"], arm(np.eye(2), deviation), 100.0)
    # a frame of 30 ms is three steps of 10 ms
    band = 4.5 / np.sqrt(takes * 100 * (1 - keep))
    np.testing.assert_allclose([row[4] for row in left], [keep] * 2 + [keep**3] * 2, atol=band)
    assert abs(keep - keep**3) > band
