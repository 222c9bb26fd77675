"""The root of the weight's equation, from any guess, is where the curve has that weight."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models.wishart.bound import ALONG, PULL, ROWS, Y, place
from pipeline.models.wishart.root import root
from pipeline.models.wishart.triangles import factorize


@pytest.mark.parametrize("m", [1, 2, 3, 6])
@pytest.mark.parametrize("delta", [0.1, 0.8, 1e100])
def test_the_place_of_every_weight_between_the_ends_is_reached(m, delta):
    rng, held = np.random.default_rng(1), []
    for share in (1e-3, 0.1, 0.5, 0.7, 0.9, 0.999):
        matrix, noise, e = (rng.standard_normal(size) for size in ((m + 1, m), m + 1, m))
        noise *= 4
        squares, room = np.empty((3, m, m)), np.empty((ROWS, m))
        squares[0], room[ALONG], room[PULL] = (
            matrix.T @ matrix,
            e / np.linalg.norm(e),
            noise @ matrix,
        )
        factorize(squares[0], 0.0, squares[1])
        outside = noise - matrix @ np.linalg.lstsq(matrix, noise)[0]
        parts = delta, outside @ outside
        most = np.linalg.norm(room[PULL]) / np.linalg.norm(noise)
        c = root(share * most, *parts, 0.0, most, 200, squares, room)
        # the place itself; to either side of it the weight is another
        u = room[Y] - c * room[ALONG]
        s = u @ (room[PULL] - squares[0] @ room[Y]) / (u @ u)
        below, above = (place(s * k, *parts, squares, room)[1] for k in (0.999, 1.001))
        assert below < share * most < above
        held.append(c > 0)
        assert root(share * most, *parts, 0.0, most, 0, squares, room) == -1
    # of one row there is nothing across e
    assert any(held) == (delta < 1) or m == 1
