"""What measures how cost grows: slopes, the memory of a call, and that every call that is measured can still be made."""

from __future__ import annotations

import cost_growth
import numpy as np
import pandas as pd
import pytest
from depth_scenario import record
from growth_figure import draw


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return record(tmp_path_factory.mktemp("recording"), 2)


def test_the_slope_is_the_power_of_the_larger_sizes():
    sizes = 2.0 ** np.arange(8)
    assert cost_growth.slope(sizes, 3 * sizes**1.5) == pytest.approx(1.5)
    # what every call costs, whatever its size, tells in the smaller half
    assert cost_growth.slope(sizes, sizes + np.where(sizes < 16, 5.0, 0.0)) == pytest.approx(1.0)


@pytest.mark.parametrize("over", cost_growth.SIZES)
def test_what_is_measured_can_be_called(over, recording):
    seconds, megabytes = cost_growth.in_a_process(cost_growth.cost, over, cost_growth.SIZES[over][0], recording)
    assert seconds > 0 and megabytes >= 0


def test_the_memory_is_that_of_the_call(monkeypatch):
    # 8 MB a size, every page touched; the 80 MB that are there before are not the call's
    before = np.ones(10_000_000)
    monkeypatch.setattr(cost_growth, "call_of", lambda over, size, recording: lambda: before[: size * 1_000_000].copy())
    monkeypatch.setattr(cost_growth, "SIZES", {"arrays": (1, 4)})
    for size in (4, 8):
        _, megabytes = cost_growth.in_a_process(cost_growth.cost, "arrays", size, None)
        assert megabytes == pytest.approx(8 * size, rel=0.1)


def test_a_memory_that_does_not_grow_is_not_drawn():
    table = pd.DataFrame({"over": "takes", "size": [1, 2, 4], "seconds": [1.0, 2.0, 4.0], "megabytes": [0.1, 0.0, 0.2], "time_slope": 1.0})
    time, memory = draw(table.assign(memory_slope=np.nan)).axes
    labels = [[line.get_label() for line in axes.get_lines() if not line.get_label().startswith("_")] for axes in (time, memory)]
    assert labels == [["takes: 1.00"], []]
