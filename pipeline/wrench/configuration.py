"""A configuration of the experiment as a cable system: what is known of its cables, and the bounds
of the class that it belongs to.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import ConfigError
from pipeline.core.options.instruments import Configuration, Force
from pipeline.wrench.bounds import Bounds
from pipeline.wrench.parametric import CableSystem


def configuration_bounds(force: Force, configuration: Configuration) -> Bounds:
    """The bounds given for the model; of attachments as multiples of the characteristic length."""
    elevation, attachment = configuration.elevation_bounds, configuration.attachment_bounds
    return Bounds(
        tuple(force.tension_bounds),
        tuple(configuration.direction_bounds),
        tuple(force.tension_std_bounds),
        tuple(force.kappa_bounds),
        None if elevation is None else tuple(elevation),
        None if attachment is None else tuple(np.divide(attachment, force.length)),
    )


def nominal_system(force: Force, configuration: Configuration) -> CableSystem:
    """The system at its means, its attachments as multiples of the characteristic length.

    The matrix model knows no law of the directions: the concentration is given and does not enter
    it. Raises ConfigError where robots have no spread of their tension.
    """
    agents, azimuth = len(configuration.tension), np.array(configuration.direction)
    if len(force.tension_std) < agents:
        raise ConfigError(
            f"tension_std: {len(force.tension_std)} values for the {agents} robots of "
            f"{configuration.file}",
            key="dataset.force.tension_std",
        )
    direction = [np.cos(azimuth), np.sin(azimuth)]
    if (elevation := configuration.elevation) is not None:
        direction = [*(np.cos(elevation) * part for part in direction), np.sin(elevation)]
    places = configuration.attachment
    return CableSystem(
        configuration.tension,
        np.stack(direction, axis=-1),
        force.tension_std[:agents],
        np.full(agents, force.kappa_bounds[0]),
        None if places is None else np.array(places),
    ).in_units_of(force.length)
