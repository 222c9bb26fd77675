"""Random numbers of compiled code: NumPy's own, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.motion.compiled.draws import chi_squares, normals


@pytest.mark.parametrize("generator", [np.random.PCG64, np.random.SFC64])
@pytest.mark.parametrize("degrees", [0.3, 1.0, 2.0, 2.0001, 3.7, 62.0, 1e6])
def test_chi_squares_are_numpys(degrees, generator):
    one, other = np.random.Generator(generator(7)), np.random.Generator(generator(7))
    assert np.array_equal(chi_squares(one, degrees, 20_000), other.chisquare(degrees, 20_000))
    assert one.random() == other.random()


def test_normals_are_numpys_particle_by_particle():
    one, other = np.random.default_rng(8), np.random.default_rng(8)
    assert np.array_equal(normals(one, 5000, 7), other.standard_normal((5000, 7)).T)
    assert one.random() == other.random()
