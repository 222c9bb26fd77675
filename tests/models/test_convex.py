"""The printed problems never yield numbers from a status that is not optimal."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import SolverError
from pipeline.models.convex import solve_noise_covariance, solve_perturbation


def test_a_log_det_problem_with_the_bound_below_the_norm_is_refused():
    with pytest.raises(SolverError):
        solve_noise_covariance(19.0, 0.1, 18.0, 3, 3)


def test_a_perturbation_problem_without_numbers_is_refused():
    with pytest.raises(SolverError):
        solve_perturbation(np.full(3, np.nan), np.ones(3), np.eye(3), np.eye(3), (0.5, 0.5), 0.01)
