"""Whatever was found is kept or accounted for, movement by movement and by name."""

from __future__ import annotations

import pandas as pd

from pipeline.recordings.account import account
from pipeline.recordings.limits import beside_limits
from pipeline.recordings.quality import quality_row

MOTION = ["a/1.csv", "a/2.csv", "LICENSE", "old/3.csv", "old/4.csv"]
FILES = [pd.DataFrame({"file": files}) for files in (MOTION, [*MOTION[2:], "depth/0.png"])]


def test_each_step_says_what_it_found_kept_and_left_out():
    rows = [
        quality_row(take, "training", "joint log", *row)
        for take, held in {
            "a": [("repetitions", 2), ("excursions_cut_off", 1), ("excursions_other_motion", 3)],
            "b": [("repetitions", 0), ("excursions_cut_off", 1), ("excursions_other_motion", 0)],
            "a_1": [("disturbance", 7.0, "robust standard deviations")],
            "a_2": [("disturbance", 0.5, "robust standard deviations")],
        }.items()
        for row in held
    ]
    quality = pd.DataFrame(rows)
    table = account(FILES, quality, beside_limits(quality, {"disturbance": 6.0}))
    assert table.to_numpy().tolist() == [
        ["files", "all", 6, 3, "LICENSE, old (2)"],
        ["motions", "a", 6, 2, "cut off 1, other motion 3"],
        ["motions", "b", 1, 0, "cut off 1"],
        ["takes", "training", 2, 1, "a_1 (disturbance 7 beyond 6)"],
    ]
    # the control: without the limit nothing is left out
    stays = account(FILES, quality, beside_limits(quality, {}))
    assert stays.iloc[-1].tolist() == ["takes", "training", 2, 2, ""]


def test_of_many_places_that_nothing_reads_the_first_are_named():
    many = pd.DataFrame({"file": [f"{i:02}/x" for i in range(11)]})
    none = pd.DataFrame(columns=["take", "quantity", "value", "part"])
    takes = pd.DataFrame(columns=["take", "part", "left_out", "beyond"])
    (row,) = account([many, many], none.astype({"quantity": str}), takes).to_numpy().tolist()
    assert row == ["files", "all", 11, 0, "00, 01, 02, 03, 04, 05, 06, 07, and in 3 more places"]
