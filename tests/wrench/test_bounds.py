"""Systems fill the bounds that the options state, and bounds without a system are refused."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.stats import kstest

from pipeline.core.errors import ConfigError
from pipeline.core.options.instruments import Arrangement, Force
from pipeline.wrench.bounds import Bounds, configuration_bounds, draw_systems, nominal_system

RANGES = {"tension": (3.0, 5.0), "direction": (np.pi / 4, np.pi)}
RANGES |= {"tension_sd": (0.5, 1.0), "concentration": (100.0, 800.0)}
STUDY = Bounds(**RANGES)
SPACE = Bounds(**RANGES, elevation=(0.2, 1.3), attachment=(-0.3, 0.5))


def characteristics(system):
    """Values that bounds name, by name; angles from the directions."""
    e, values = system.direction, {k: v for k, v in vars(system).items() if v is not None}
    values["direction"] = np.arctan2(e[..., 1], e[..., 0])
    return values | ({"elevation": np.arcsin(e[..., 2])} if system.dimension == 3 else {})


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


PLANAR = {"file": "a.csv", "direction": [0.1, 2.0], "tension": [5.0, 4.0]}
PLANAR |= {"direction_bounds": [0.0, 3.0]}
SPATIAL = PLANAR | {"elevation": [0.3, -0.4], "elevation_bounds": [-0.5, 0.5]}
SPATIAL |= {"attachment": [[0.1, 0.0, 0.02], [-0.1, 0.0, 0.02]], "attachment_bounds": [-0.1, 0.1]}


def force(configuration: Arrangement, **changes) -> Force:
    bounds = {"kappa_bounds": [400.0, 900.0], "tension_std_bounds": [0.4, 0.8]}
    bounds |= {"tension_bounds": [3.0, 6.0], "configurations": {"C1": configuration}}
    return Force(tare=1.0, tension_std=[0.5, 0.6, 0.7], **bounds, **changes)


def test_a_configuration_in_space_has_elevations_and_attachments_over_the_length():
    configuration = Arrangement(**SPATIAL)
    options = force(configuration, length=0.2)
    system = nominal_system(options, configuration)
    np.testing.assert_allclose(np.linalg.norm(system.direction, axis=1), 1)
    np.testing.assert_allclose(np.arcsin(system.direction[:, 2]), SPATIAL["elevation"])
    np.testing.assert_allclose(np.arctan2(*system.direction[:, 1::-1].T), SPATIAL["direction"])
    np.testing.assert_allclose(0.2 * system.attachment, SPATIAL["attachment"])
    planar = Arrangement(**PLANAR)
    met = nominal_system(force(planar), planar)
    np.testing.assert_allclose(np.arctan2(*met.direction.T[::-1]), PLANAR["direction"])
    assert met.tension_sd.tolist() == [0.5, 0.6] and met.attachment is None
    bounds = configuration_bounds(force(planar), planar)
    assert (bounds.dimension, bounds.attachment) == (2, None)
    bounds = configuration_bounds(options, configuration)
    assert bounds.elevation == (-0.5, 0.5)
    np.testing.assert_allclose(bounds.attachment, [-0.5, 0.5])


def test_more_cables_than_robots_and_a_length_that_is_none_are_refused():
    four = {name: PLANAR[name] * 2 for name in ("direction", "tension")}
    configuration = Arrangement(**(PLANAR | four))
    with pytest.raises(ConfigError, match="3 values for the 4 robots"):
        nominal_system(force(configuration), configuration)
    with pytest.raises(ConfigError, match=r"length: .* greater than 0, got 0\.0"):
        force(configuration, length=0.0)
    with pytest.raises(ConfigError, match="point"):
        force(configuration, point=[0.0, 0.0])
