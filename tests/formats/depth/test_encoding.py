"""What the values of a depth image mean."""

from __future__ import annotations

import numpy as np
import pytest
from depth_files import frame

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import Depth
from pipeline.core.validation import validated
from pipeline.formats.depth.image import Encoding, RawDepth, metres


@pytest.mark.parametrize(
    "description",
    ["", "scale", "scale=x", "rescale=2", "scale=1 scale=2", "scale=-1", "scale=1e999", "scale=0"],
)
def test_a_description_without_one_positive_scale_is_refused(description):
    with pytest.raises(RecordingError, match="'scale'"):
        metres(RawDepth(frame(), description), Encoding("plain", 1000, scale_key="scale"))


@pytest.mark.parametrize(
    "description", ["scale=2", "scale: 2.0", '{"scale": 2}', "unit scale 2 (mm)"]
)
def test_a_scale_is_found_in_the_ways_that_people_write_it(description):
    raw = np.full((2, 2), 500, np.uint16)
    assert (
        metres(RawDepth(raw, description), Encoding("plain", 1000, scale_key="scale")) == 1
    ).all()


def test_rotated_bits_are_turned_back():
    millimetres = np.array([[0, 1, 1234, 8191]], np.uint16)
    stored = (millimetres << 3) | (millimetres >> 13)
    depth = metres(RawDepth(stored), Encoding("rotated_bits", 1000))
    np.testing.assert_allclose(depth[0, 1:], [0.001, 1.234, 8.191], rtol=1e-6)
    assert np.isnan(depth[0, 0])


def test_disparities_become_depth_by_the_parameters_given_and_others_none():
    disparity = np.array([[0, 500, 1000, 1092, 1093, 2047]], np.uint16)
    encoding = Encoding("disparity", 1, disparity=(351.3, 1092.5))
    depth = metres(RawDepth(disparity.byteswap()), encoding)
    np.testing.assert_allclose(
        depth[0, 1:4], 351.3 / (1092.5 - np.array([500, 1000, 1092])), rtol=1e-6
    )
    assert np.isnan(depth[0, [0, 4, 5]]).all()
    # bytes that were not swapped are no disparities of eleven bits
    with pytest.raises(RecordingError, match="11-bit"):
        metres(RawDepth(disparity), encoding)


def test_zero_nan_infinite_negative_and_saturated_values_are_no_depth():
    floats = np.array([[0, np.nan, np.inf, -1, 0.5, 7.9, 8, 9]], np.float32)
    depth = metres(RawDepth(floats), Encoding("plain", 1, saturation=8))
    np.testing.assert_array_equal(
        np.isfinite(depth), [[False, False, False, False, True, True, False, False]]
    )
    counts = np.array([[0, 1, 65534, 65535]], np.uint16)
    assert np.isnan(
        metres(RawDepth(counts), Encoding("plain", 1000, saturation=65535))
    ).tolist() == [[True, False, False, True]]
    assert np.isnan(metres(RawDepth(counts), Encoding("plain", 1000))).tolist() == [
        [True, False, False, False]
    ]


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"encoding": "mm"}, "encoding"),
        ({"units_per_metre": 0}, "units_per_metre"),
        ({"units_per_metre": float("nan")}, "units_per_metre"),
        ({"encoding": "disparity"}, "disparity"),
        ({"disparity": [1.0, 2.0]}, "disparity"),
    ],
)
def test_encodings_that_do_not_exist_or_lack_parameters_are_refused(options, key):
    pose = {"position": [0.0] * 3, "rpy": [0.0] * 3}
    workspace = dict.fromkeys(("half_depth", "girth", "column_half_width", "column_top"), 0.1)
    workspace |= {"floor": 0.0, "min_pixels": 1, "max_points": 9}
    sound = {"takes": "*", "encoding": "plain", "units_per_metre": 1000.0, "rate": 30.0}
    sound |= {"camera": pose, "workspace": workspace, "search": 0.1}
    assert validated(Depth, sound).disparity is None
    with pytest.raises(ConfigError) as refused:
        validated(Depth, sound | options, "dataset.depth")
    assert refused.value.evidence["key"] == f"dataset.depth.{key}"


def test_floating_point_has_no_encoded_bits():
    with pytest.raises(RecordingError, match="float32"):
        metres(RawDepth(np.ones((2, 2), np.float32)), Encoding("rotated_bits", 1000))
