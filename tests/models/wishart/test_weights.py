"""The weights of the perturbation samples, and what the paper's estimator makes of them."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import ModelDomainError
from pipeline.models.wishart.perturbation import (
    fit_perturbations,
    objective_weights,
)


def test_the_noise_at_rest_costs_as_much_as_a_perturbation_of_the_size_of_the_identity():
    alpha1, alpha2 = objective_weights(1e-3, 3)
    assert alpha1 + alpha2 == pytest.approx(1, abs=1e-15)
    assert alpha1 * 1e-3 == pytest.approx(alpha2 * np.linalg.norm(np.eye(3)))
    with pytest.raises(ModelDomainError, match="at rest"):
        objective_weights(0.0, 3)


def test_a_factor_multiplies_the_ratio_of_the_weights_alone():
    (alpha1, alpha2), (other1, other2) = objective_weights(1e-3, 3), objective_weights(1e-3, 3, 0.3)
    assert other1 + other2 == pytest.approx(1, abs=1e-15)
    assert other2 / other1 == pytest.approx(0.3 * alpha2 / alpha1)
    with pytest.raises(ModelDomainError, match="factor"):
        objective_weights(1e-3, 3, 0.0)


@pytest.mark.parametrize(
    ("pair", "floor"), [((0.0, 1.0), 0.1), ((0.5, -0.1), 0.1), ((0.5, 0.5), 0.0), ((0.5, 0.5), 1.0)]
)
def test_weights_and_floor_outside_their_range_are_refused(pair, floor):
    with pytest.raises(ModelDomainError, match="alpha1"):
        fit_perturbations(np.zeros((1, 3)), np.ones((1, 3)), np.eye(3)[None], pair, floor)
