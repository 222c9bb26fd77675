"""A configuration of the options becomes the system and the bounds that it states."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.core.options.instruments import Configuration, Force
from pipeline.wrench.configuration import configuration_bounds, nominal_system

PLANAR = {
    "file": "a.csv",
    "direction": [0.1, 2.0],
    "tension": [5.0, 4.0],
    "direction_bounds": [0.0, 3.0],
}
SPATIAL = PLANAR | {
    "elevation": [0.3, -0.4],
    "elevation_bounds": [-0.5, 0.5],
    "attachment": [[0.1, 0.0, 0.02], [-0.1, 0.0, 0.02]],
    "attachment_bounds": [-0.1, 0.1],
}


def force(configuration: Configuration, **changes) -> Force:
    return Force(
        tare=1.0,
        tension_std=[0.5, 0.6, 0.7],
        kappa_bounds=[400.0, 900.0],
        tension_std_bounds=[0.4, 0.8],
        tension_bounds=[3.0, 6.0],
        configurations={"C1": configuration},
        **changes,
    )


def test_a_planar_configuration_has_angles_and_the_first_robots_spread():
    configuration = Configuration(**PLANAR)
    system = nominal_system(force(configuration), configuration)
    np.testing.assert_allclose(np.arctan2(*system.direction.T[::-1]), PLANAR["direction"])
    assert system.tension_sd.tolist() == [0.5, 0.6] and system.attachment is None
    bounds = configuration_bounds(force(configuration), configuration)
    assert (bounds.dimension, bounds.attachment) == (2, None)


def test_a_configuration_in_space_has_elevations_and_attachments_over_the_length():
    configuration = Configuration(**SPATIAL)
    options = force(configuration, length=0.2)
    system = nominal_system(options, configuration)
    np.testing.assert_allclose(np.linalg.norm(system.direction, axis=1), 1)
    np.testing.assert_allclose(np.arcsin(system.direction[:, 2]), SPATIAL["elevation"])
    np.testing.assert_allclose(np.arctan2(*system.direction[:, 1::-1].T), SPATIAL["direction"])
    np.testing.assert_allclose(0.2 * system.attachment, SPATIAL["attachment"])
    bounds = configuration_bounds(options, configuration)
    assert bounds.elevation == (-0.5, 0.5)
    np.testing.assert_allclose(bounds.attachment, [-0.5, 0.5])


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"elevation_bounds": None}, "elevation"),
        ({"elevation": [0.3]}, "elevation"),
        ({"attachment": None}, "attachment"),
        ({"attachment": [[0.1, 0.0], [0.1, 0.0]]}, "attachment"),
    ],
)
def test_cables_that_are_half_described_are_refused(changes, key):
    with pytest.raises(ConfigError, match=key) as refused:
        Configuration(**(SPATIAL | changes))
    assert refused.value.evidence["key"].endswith(key)


def test_more_cables_than_robots_and_a_length_that_is_none_are_refused():
    four = {name: PLANAR[name] * 2 for name in ("direction", "tension")}
    configuration = Configuration(**(PLANAR | four))
    with pytest.raises(ConfigError, match="3 values for the 4 robots"):
        nominal_system(force(configuration), configuration)
    with pytest.raises(ConfigError, match=r"length: .* greater than 0, got 0\.0"):
        force(configuration, length=0.0)
    with pytest.raises(ConfigError, match="point"):
        force(configuration, point=[0.0, 0.0])
