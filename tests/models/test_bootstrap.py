"""Standard errors by the bootstrap over takes are the spread of the estimates over independent
recordings.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models import kinds
from pipeline.models.bootstrap import replicate, resampled_estimator, spreads
from pipeline.models.kinds import estimate
from pipeline.models.noise import mean_covariance
from pipeline.models.steps import Recorded
from pipeline.models.wishart.law import WishartModel
from pipeline.studies.recovery.stage import drawn

ADDITIVE = kinds.options_type("additive")("additive", estimator="paper")
LIKELIHOOD = kinds.options_type("wishart")(
    "wishart", estimator="likelihood", decomposition="pivoted_lu"
)
MEASUREMENT = np.diag([0.6, 1.5, 1.7]) * 1e-6
TAKES = 30


def correlated(takes: int, rng: np.random.Generator) -> np.ndarray:
    """(takes, 20, 3) noise in rad whose size differs from take to take, so that the squares of the
    steps of a take go together.
    """
    size = np.sqrt(rng.gamma(4.0, 0.25, (takes, 1, 1)))
    return 5e-3 * size * rng.standard_normal((takes, 20, 3))


def recording(chain, poses, step, noise: np.ndarray) -> Recorded:
    return Recorded(
        chain,
        np.broadcast_to(poses[: noise.shape[1]], noise.shape),
        np.tile(step, (noise.shape[1], 1)),
        noise,
        ("a", "b", "c"),
        MEASUREMENT,
    )


def standard_error(recorded: Recorded, replicates: int, rng: np.random.Generator) -> float:
    estimator = resampled_estimator(recorded, ADDITIVE, estimate(recorded, ADDITIVE))
    result, lost = spreads([replicate(estimator, len(recorded.q), rng) for _ in range(replicates)])
    assert lost == 0
    return result["sigma_omega_11_rad2"].standard_error


def test_the_standard_error_is_the_spread_over_independent_recordings(chain, poses, step):
    rng = np.random.default_rng(1)
    spread = np.std([mean_covariance(correlated(TAKES, rng))[0, 0] for _ in range(1000)], ddof=1)
    recordings = [correlated(TAKES, rng) for _ in range(12)]
    errors = [standard_error(recording(chain, poses, step, noise), 60, rng) for noise in recordings]
    assert abs(np.mean(errors) / spread - 1) < 0.15
    # control: steps drawn one by one, as if those of a take were independent
    single = [
        standard_error(recording(chain, poses, step, noise.reshape(-1, 1, 3)), 60, rng)
        for noise in recordings
    ]
    assert np.mean(single) / spread < 0.65


def wishart(chain, poses, step, takes: int, seed: int) -> Recorded:
    still = recording(chain, poses, step, np.zeros((takes, 20, 3)))
    return drawn(WishartModel(0.25), still, np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("kind", "estimator", "tolerance"),
    [
        ("wishart", "moments", 1e-12),
        ("wishart", "paper", 1e-12),  # the weights follow from a known measurement noise here
        ("wishart", "likelihood", 2e-4),
        ("gaussian", "moments", 1e-12),
        ("gaussian", "likelihood", 5e-3),
    ],
)
def test_resampled_sums_give_the_estimate_of_the_resampled_takes(
    chain, poses, step, kind, estimator, tolerance
):
    recorded = wishart(chain, poses, step, 8, 2)
    options = kinds.options_type(kind)(kind, estimator=estimator)
    found = estimate(recorded, options)
    name = {"wishart": "sigma_b", "gaussian": "noise_level"}[kind]
    for takes in (np.arange(8), np.array([0, 0, 3, 5, 5, 5, 6, 7]), np.array([1, 2])):
        anew = estimate(recorded.subset(takes), options).estimates[name]
        assert found.from_takes(takes)[name] == pytest.approx(anew, rel=tolerance)
    # control: the last takes have another estimate than all
    assert abs(found.estimates[name] / anew - 1) > max(2e-3, tolerance)


def test_a_replicate_without_an_estimate_is_counted_and_no_number(chain, poses, step):
    recorded = recording(chain, poses, step, correlated(1, np.random.default_rng(5)))
    estimator = resampled_estimator(
        recorded, ADDITIVE, estimate(recorded.subset(np.array([0, 0])), ADDITIVE)
    )
    result = [replicate(estimator, 1, np.random.default_rng(seed)) for seed in range(3)]
    assert result == [None, None, None] and spreads(result) == ({}, 3)
    known = [{"a": 1.0, "b": 2.0}, None, {"a": 3.0}]
    spread, lost = spreads(known)
    assert (
        lost == 1
        and set(spread) == {"a"}
        and spread["a"].standard_error == pytest.approx(np.sqrt(2))
    )
