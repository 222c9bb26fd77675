"""Planar cable systems whose cables meet in one point, by their angles."""

from __future__ import annotations

import numpy as np

from pipeline.wrench.parametric import CableSystem


def planar_cables(tension, angle, tension_sd, concentration) -> CableSystem:
    """Return the system whose cables point along ``angle`` θ̲ (..., m) in rad."""
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return CableSystem(tension, direction, tension_sd, concentration)
