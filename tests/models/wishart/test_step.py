"""The exponential that the compiled Wishart step takes without the C library."""

from __future__ import annotations

import numpy as np
from compiled_calls import from_python

from pipeline.models.wishart.step import expm1


def test_the_exponential_less_one_is_the_librarys():
    x = np.concatenate([[0.0, 1e-300, 1e-17], np.geomspace(1e-12, 87.9, 5000)])
    result = np.array(list(map(from_python(expm1), x)))
    np.testing.assert_allclose(result, np.expm1(x), rtol=2e-14, atol=0)
