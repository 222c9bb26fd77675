"""The folded frames of a chain carry its tip where the placements carry it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.arm.folded import folded


def carried(placements: np.ndarray, q: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """Rotation and place of the tip, placement by placement."""
    rotation, place = Rotation.identity(), np.zeros(3)
    for placement, angle in zip(placements, [*q, 0.0], strict=True):
        place = place + rotation.apply(placement[9:])
        rotation *= Rotation.from_matrix(placement[:9].reshape(3, 3))
        rotation *= Rotation.from_rotvec([0, 0, angle])
    return rotation, place


def by_frames(frames: np.ndarray, q: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """The same, turn by turn, shift by shift and tilt by tilt."""
    rotation, place = Rotation.identity(), np.zeros(3)
    for (turn, cosine, sine, *shift), angle in zip(frames, [0.0, *q, 0.0], strict=True):
        rotation *= Rotation.from_rotvec([0, 0, turn + angle])
        place = place + rotation.apply(shift)
        rotation *= Rotation.from_rotvec([np.arctan2(sine, cosine), 0, 0])
    return rotation, place


@pytest.mark.parametrize("tilt", [None, 0.0, 1e-9, -np.pi / 2, np.pi])
def test_the_tip_is_where_the_placements_have_it(tilt):
    rng = np.random.default_rng(1)
    turns = Rotation.random(5, rng=rng)
    if tilt is not None:  # axes that are parallel, or nearly so, or across each other
        turns = Rotation.from_euler("zxz", [[angle, tilt, -angle / 2] for angle in range(5)])
    placements = np.hstack([turns.as_matrix().reshape(-1, 9), rng.uniform(-1, 1, (5, 3))])
    q = rng.uniform(-3, 3, 4)
    (rotation, place), (same, there) = carried(placements, q), by_frames(folded(placements), q)
    np.testing.assert_allclose(there, place, atol=1e-14)
    assert (rotation.inv() * same).magnitude() < 1e-14
    assert np.linalg.norm(by_frames(folded(placements), q + 0.01)[1] - place) > 1e-4
