"""The figure of the recordings' quality: a strip for every measure there is, the limits, and the
takes that are left out.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.figures import recording_quality
from pipeline.figures.recording_quality import KEPT, LEFT_OUT, STRIPS


@pytest.fixture
def strips(tables):
    return recording_quality.draw(tables["takes"]).axes


def marks(axes, mark: dict) -> list[tuple[float, float]]:
    lines = [line for line in axes.lines if line.get_marker() == mark["marker"]]
    return [
        (float(x), float(y))
        for line in lines
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    ]


def limits(axes) -> list[float]:
    return [line.get_ydata()[0] for line in axes.lines if line.is_dashed()]


def test_each_measure_has_a_strip_with_every_take_in_the_unit_beside_it(strips):
    assert [axes.get_ylabel() for axes in strips] == [
        STRIPS[measure][0] for measure in ("interpolated", "residual_rms", "clock_drift")
    ]
    assert np.array(marks(strips[1], KEPT)) == pytest.approx(np.array([(1, 0.2), (3, 0.3)]))
    assert np.array(marks(strips[1], LEFT_OUT)) == pytest.approx(np.array([(2, 2.0)]))


def test_a_take_that_is_left_out_is_crossed_in_every_strip_and_named(strips):
    assert [len(marks(axes, LEFT_OUT)) for axes in strips] == [1, 1, 1]
    assert [text.get_text() for text in strips[0].texts] == ["train_002"]


def test_a_limit_is_drawn_where_one_is_stated_and_on_either_side_of_what_has_a_sign(strips):
    assert [limits(axes) for axes in strips] == [[], [1.0], [-20.0, 20.0]]
    # and every one can be seen
    for axes in strips:
        low, high = axes.get_ylim()
        assert all(low < limit < high for limit in limits(axes))


def test_a_joint_log_alone_has_a_figure(tables):
    takes = tables["takes"].query("measure == 'residual_rms'")
    takes = takes.assign(
        measure="disturbance", unit="robust standard deviations", limit=np.nan, left_out=False
    )
    (strip,) = recording_quality.draw(takes).axes
    assert strip.get_ylabel() == STRIPS["disturbance"][0] and len(marks(strip, KEPT)) == 3
