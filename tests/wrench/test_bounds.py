"""Systems drawn within bounds fill them, and bounds that bound no system are refused."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.stats import kstest

from pipeline.core.errors import ConfigError
from pipeline.wrench.bounds import Bounds, draw_systems, systems_at

RANGES = {
    "tension": (3.0, 5.0),
    "direction": (np.pi / 4, np.pi),
    "tension_sd": (0.5, 1.0),
    "concentration": (100.0, 800.0),
}
STUDY = Bounds(**RANGES)


SPACE = Bounds(**RANGES, elevation=(0.2, 1.3), attachment=(-0.3, 0.5))


def characteristics(system):
    """What bounds name, by name; angles from the directions."""
    e = system.direction
    values = {
        "tension": system.tension,
        "direction": np.arctan2(e[..., 1], e[..., 0]),
        "tension_sd": system.tension_sd,
        "concentration": system.concentration,
    }
    if system.dimension == 3:
        values |= {"elevation": np.arcsin(e[..., 2])}
    return values | ({} if system.attachment is None else {"attachment": system.attachment})


@pytest.mark.parametrize("bounds", [STUDY, replace(STUDY, attachment=(0.1, 0.2)), SPACE])
def test_systems_stay_within_their_bounds_and_fill_them(bounds):
    system = draw_systems(bounds, 4000, 3, np.random.default_rng(12))
    assert system.direction.shape == (4000, 3, bounds.dimension)
    drawn = characteristics(system)
    assert drawn.keys() == {f.name for f in fields(bounds) if getattr(bounds, f.name) is not None}
    for name, values in drawn.items():
        low, high = getattr(bounds, name)
        assert low - 1e-12 <= values.min() < low + 0.01 * (high - low)
        assert high + 1e-12 >= values.max() > high - 0.01 * (high - low)


def test_directions_in_space_are_uniform_on_the_sphere_and_not_in_their_elevation():
    height = draw_systems(SPACE, 4000, 3, np.random.default_rng(13)).direction[..., 2].ravel()
    low, high = np.sin(SPACE.elevation)
    assert kstest(height, "uniform", (low, high - low)).pvalue > 1e-3
    low, high = SPACE.elevation
    assert kstest(np.arcsin(height), "uniform", (low, high - low)).pvalue < 1e-6


def test_planar_systems_whose_cables_meet_are_drawn_as_they_were_before_there_were_others():
    drawn = draw_systems(STUDY, 2, 3, np.random.default_rng(14))
    shares = np.random.default_rng(14).random((4, 2, 3))
    for (name, (low, high)), share in zip(RANGES.items(), shares, strict=True):
        np.testing.assert_allclose(characteristics(drawn)[name], low + (high - low) * share)


def test_the_corners_of_the_unit_cube_are_the_bounds():
    points = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.5], [1.0, 1.0]])
    drawn = characteristics(systems_at(STUDY, points))
    np.testing.assert_allclose(drawn["tension"], [3.0, 5.0])
    np.testing.assert_allclose(drawn["direction"], [np.pi, np.pi / 4])
    np.testing.assert_allclose(drawn["tension_sd"], [0.5, 0.75])
    np.testing.assert_allclose(drawn["concentration"], [800.0, 800.0])


@pytest.mark.parametrize(
    "change",
    [
        {"tension": (5.0, 3.0)},
        {"tension": (0.0, 3.0)},
        {"concentration": (0.0, np.inf)},
        {"elevation": (0.0, 2.0)},
        {"attachment": (0.2, 0.1)},
    ],
)
def test_bounds_that_bound_no_system_are_refused(change):
    with pytest.raises(ConfigError):
        Bounds(**(RANGES | change))
