"""Systems drawn within bounds fill them, and bounds that bound no system are refused."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.wrench.bounds import Bounds, draw_systems, systems_at

RANGES = {
    "tension": (3.0, 5.0),
    "direction": (np.pi / 4, np.pi),
    "tension_sd": (0.5, 1.0),
    "concentration": (100.0, 800.0),
}
STUDY = Bounds(**RANGES)


def test_systems_stay_within_their_bounds_and_fill_them():
    system = draw_systems(STUDY, 4000, 3, np.random.default_rng(12))
    for name, (low, high) in RANGES.items():
        values = getattr(system, name)
        assert values.shape == (4000, 3)
        assert low <= values.min() < low + 0.01 * (high - low)
        assert high >= values.max() > high - 0.01 * (high - low)


def test_the_corners_of_the_unit_cube_are_the_bounds():
    system = systems_at(STUDY, np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.5], [1.0, 1.0]]))
    np.testing.assert_allclose(system.tension, [3.0, 5.0])
    np.testing.assert_allclose(system.direction, [np.pi, np.pi / 4])
    np.testing.assert_allclose(system.tension_sd, [0.5, 0.75])
    np.testing.assert_allclose(system.concentration, [800.0, 800.0])


@pytest.mark.parametrize(
    "change", [{"tension": (5.0, 3.0)}, {"tension": (0.0, 3.0)}, {"concentration": (0.0, np.inf)}]
)
def test_bounds_that_bound_no_system_are_refused(change):
    with pytest.raises(ConfigError):
        Bounds(**(RANGES | change))
