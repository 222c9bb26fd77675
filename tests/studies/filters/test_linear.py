"""The memory of a closed loop beside that of the takes."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.studies.filters.linear import first_order


def test_the_first_order_memory_is_a_power_that_agrees_a_frame_later():
    correlation = np.cos(np.arange(10) / 8)
    power = first_order(correlation, 3)
    assert power[0] == 1 and power[3] == pytest.approx(correlation[3])
    np.testing.assert_allclose(power[1:] / power[:-1], power[1])
    # what has turned over by then is nothing
    assert np.all(first_order(-correlation, 3)[1:] == 0)
