"""The arm's points, beside the table of the frames."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.recordings.depth_points import arm_points, write_points


def test_the_points_of_each_frame_are_read_back_as_they_were_written(tmp_path):
    rng = np.random.default_rng(4)
    clouds = [rng.random((count, 2)) for count in (3, 0, 5)]
    write_points(clouds, "test_001", tmp_path)
    rows = pd.DataFrame({"take": "test_001", "points": [3, 0, 5]})
    for points, cloud in zip(arm_points(rows, tmp_path), clouds, strict=True):
        np.testing.assert_array_equal(points, cloud)
