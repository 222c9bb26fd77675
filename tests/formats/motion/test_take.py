from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.motion.take import rate_from_times, settle_unit


@pytest.mark.parametrize(
    ("rate", "decimals"), [(30, 2), (100, 2), (120, 3), (240, 3), (360, 3), (1000, 6)]
)
def test_a_rate_is_found_again_in_rounded_times_with_gaps(rate, decimals):
    frame = np.delete(np.arange(72210, 74210), slice(500, 900))
    assert rate_from_times(frame, np.round(frame / rate, decimals)) == rate


def test_a_rate_that_is_no_whole_number_is_not_rounded_to_one():
    frame = np.arange(1000)
    assert rate_from_times(frame, frame / 59.94) == pytest.approx(59.94, abs=1e-9)
    # the control: in five frames nobody can tell
    assert rate_from_times(frame[:5], frame[:5] / 59.94) == 60


def test_a_rate_is_found_in_times_that_are_rounded_by_more_than_half_a_frame():
    frame = np.arange(548)
    assert rate_from_times(frame, np.round(frame / 120, 2)) == 120
    assert rate_from_times(frame, np.round(frame / 119.5, 2)) != 120  # the control


def test_times_that_do_not_increase_give_no_rate():
    assert rate_from_times(np.arange(3), np.zeros(3)) is None
    assert rate_from_times(np.arange(1), np.zeros(1)) is None


@pytest.mark.parametrize("stated", ["mm", "MM", "Millimeters", " millimetres "])
def test_a_unit_is_the_files_or_the_options_and_neither_a_guess_nor_a_contradiction(
    tmp_path, stated
):
    for result in (
        settle_unit(stated, None, tmp_path, key="U"),
        settle_unit("", "mm", tmp_path, key="U"),
        settle_unit(stated, "mm", tmp_path, key="U"),
    ):
        assert result == "mm"
    for text, requested, key in (
        ("", None, "dataset.mocap.unit"),
        (stated, "m", "dataset.mocap.unit"),
        ("feet", "m", "U"),
    ):
        with pytest.raises(RecordingError) as caught:
            settle_unit(text, requested, tmp_path, key="U")
        assert caught.value.evidence["key"] == key
