"""The depth sensor's measurements: their likelihood, and the step at which each of them enters."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from plain_filter import log_likelihood
from scipy.stats import multivariate_normal

from pipeline.core.columns import pairs
from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.filtering.measurement import Measurements, measurements


def measurements_at(t, **changed) -> Measurements:
    rng = np.random.default_rng(3)
    frames = len(t)
    root = 0.05 * rng.standard_normal((frames, 3, 3))
    known = {
        "y": rng.standard_normal((frames, 3)),
        "bias": 0.1 * rng.standard_normal((frames, 3)),
        "covariance": root @ np.swapaxes(root, 1, 2) + 1e-4 * np.eye(3),
    }
    return Measurements("test07", np.asarray(t, dtype=float), **(known | changed))


def test_the_likelihood_is_the_normal_density_about_pose_and_bias():
    measured = measurements_at([0.0, 0.1, 0.2])
    q = measured.y[1] + 0.1 * np.random.default_rng(4).standard_normal((20, 3))
    expected = [
        multivariate_normal.logpdf(measured.y[1], pose + measured.bias[1], measured.covariance[1])
        for pose in q
    ]
    np.testing.assert_allclose(log_likelihood(measured, 1, q), expected, rtol=1e-9)
    # the neighbouring frame has a law of its own
    assert not np.allclose(log_likelihood(measured, 2, q), expected, rtol=0.1)


def test_a_frame_enters_at_the_step_during_which_it_was_taken():
    due, left_out = measurements_at([0.004, 0.0151, 0.019, 0.0]).schedule(5, 0.01)
    assert left_out == 0
    assert due == {
        1: [(0, pytest.approx(0.4))],
        2: [(1, pytest.approx(0.51)), (2, pytest.approx(0.9))],
        0: [(3, 1.0)],
    }


def test_a_frame_on_the_grid_enters_at_that_very_step_whatever_the_rounding_of_its_time():
    steps = np.arange(321)
    for t in (
        steps / 100,
        steps * 0.01,
        np.nextafter(steps / 100, 9.0),
        np.nextafter(steps / 100, -9.0),
    ):
        due, left_out = measurements_at(t).schedule(320, 0.01)
        assert left_out == 0
        assert due == {k: [(k, 1.0)] for k in range(321)}


def test_frames_before_the_start_and_after_the_end_are_left_out_and_counted():
    due, left_out = measurements_at([-0.02, -0.0001, 0.0, 0.05, 0.0501, 7.0]).schedule(5, 0.01)
    assert left_out == 4
    assert due == {0: [(2, 1.0)], 5: [(3, 1.0)]}


def test_a_take_without_frames_has_nothing_due():
    assert measurements_at([]).schedule(5, 0.01) == ({}, 0)


@pytest.mark.parametrize(
    "covariance",
    [np.diag([1.0, 1.0, 0.0]), np.diag([1.0, -1.0, 1.0]), np.ones((3, 3))],
    ids=["flat", "negative", "one direction"],
)
def test_a_covariance_that_is_not_positive_definite_is_refused_with_its_frame(covariance):
    covariances = np.stack([np.eye(3), covariance])
    with pytest.raises(ModelDomainError, match="frame 1") as caught:
        _ = measurements_at([0.0, 0.1], covariance=covariances).whitening
    assert caught.value.evidence == {"take": "test07", "frame": 1}


def test_values_that_are_not_finite_and_shapes_that_disagree_are_refused():
    with pytest.raises(ContractError, match=r"y is not finite.*frame 1"):
        measurements_at([0.0, 0.1], y=np.array([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]]))
    with pytest.raises(ContractError, match="bias has shape"):
        measurements_at([0.0, 0.1], bias=np.zeros(3))


def test_every_take_goes_with_the_noise_that_was_estimated_without_it():
    angles = pd.DataFrame(
        {"take": ["b", "b", "a", "a"], "frame": [1, 2, 1, 2], "t": [0.1, 0.2, 0.1, 0.2]}
    ).assign(**{"q:a": 1.0, "q:b": 2.0, "q:c": 3.0})
    noise = pd.DataFrame(
        {
            "take": ["a", "a", "b", "none"],
            "frame": [1, 2, 1, 1],
            "t": 0.1,
            "b:a": [0.1, 0.2, 0.3, 0.4],
            "b:b": 0.0,
            "b:c": 0.0,
        }
    )
    entries = [[1.0, 2.0, 3.0, 4.0], 0.1, 0.2, 5.0, 0.3, 6.0]
    noise = noise.assign(**dict(zip(pairs("r", ("a", "b", "c")), entries, strict=True)))
    first, second = measurements(angles, noise)
    assert (first.take, second.take) == ("a", "b")
    np.testing.assert_array_equal(first.bias[:, 0], [0.1, 0.2])
    np.testing.assert_array_equal(
        first.covariance[1], [[2.0, 0.1, 0.2], [0.1, 5.0, 0.3], [0.2, 0.3, 6.0]]
    )
    # the frame of b that no other take has is left out
    assert second.t.tolist() == [0.1] and second.bias[0, 0] == 0.3
