"""The paper's σ̂_B on data of known σ_B: its bias without measurement noise, and what the weights
and the floor make of it.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models.kinds import estimate, options_type
from pipeline.models.steps import Recorded
from pipeline.models.wishart.law import WishartModel
from pipeline.studies.recovery.choices import sigma_b_over_choices
from pipeline.studies.recovery.known_laws import drawn

PAPER = options_type("wishart")("wishart", estimator="paper", decomposition="pivoted_lu", floor=0.2)
LIKELIHOOD = options_type("wishart")("wishart", estimator="likelihood", decomposition="pivoted_lu")
RATIO = 1e-3


def recording(chain, poses, step, sigma_b: float, noise_std: float) -> Recorded:
    """Thirty takes of forty steps, of which ten rest."""
    v = np.tile(step, (40, 1))
    v[:10] = 0.0
    q = np.tile(poses[:40], (30, 1, 1))
    geometry = Recorded(chain, q, v, np.zeros(q.shape), ("a", "b", "c"), noise_std**2 * np.eye(3))
    return drawn(WishartModel(sigma_b), geometry, np.random.default_rng(1))


@pytest.mark.parametrize("sigma_b", [0.1, 0.25])
def test_without_measurement_noise_the_estimate_is_three_quarters_of_the_truth(
    chain, poses, step, sigma_b
):
    table = sigma_b_over_choices(
        recording(chain, poses, step, sigma_b, 0.0), PAPER, RATIO, [1e-5, 1e-3], []
    )
    assert np.all(
        (0.66 < table["sigma_b_moving"] / sigma_b) & (table["sigma_b_moving"] / sigma_b < 0.80)
    )
    # and the steps at rest, a quarter here, count as none
    np.testing.assert_allclose(table["sigma_b"], 0.75 * table["sigma_b_moving"])
    # control: the likelihood has no such bias
    likely = estimate(recording(chain, poses, step, sigma_b, 1e-5), LIKELIHOOD)
    assert abs(likely.estimates["sigma_b"] / sigma_b - 1) < 0.06


def test_the_stages_own_choice_is_one_of_those_shown(chain, poses, step):
    recorded = recording(chain, poses, step, 0.5, 1e-3)
    table = estimate(recorded, PAPER)
    ratio = table.diagnostics["weights_ratio_alpha2_over_alpha1_rad"]
    shown = sigma_b_over_choices(recorded, PAPER, ratio, [50.0, 1.0], [0.2, 0.3])
    assert list(shown["varied"]) == ["ratio", "ratio", "floor", "floor"]
    np.testing.assert_allclose(shown["sigma_b"][[1, 2]], table.estimates["sigma_b"])
    bound = table.diagnostics["problems_on_the_bound_of_definiteness"] / (30 * 30)
    np.testing.assert_allclose(shown["bound"][[1, 2]], bound)
    # and the others are not
    assert np.all(np.abs(shown["sigma_b"][[0, 3]] / table.estimates["sigma_b"] - 1) > 1e-3)


def test_a_heavy_weight_leaves_no_dispersion_and_a_low_floor_much(chain, poses, step):
    table = sigma_b_over_choices(
        recording(chain, poses, step, 0.5, 1e-3), PAPER, RATIO, [1e-2, 1e5], [0.05, 0.4]
    )
    light, heavy, low, high = table["sigma_b"]
    assert heavy == 0 < light
    assert low > 1.5 * high and table["bound"][2] < table["bound"][3]
