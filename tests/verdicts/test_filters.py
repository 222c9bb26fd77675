"""What the report says of the filters: a row each, and a verdict that follows the intervals."""

from __future__ import annotations

import pandas as pd

from pipeline.verdicts.filters import filters_part, first_lines, verdict
from pipeline.verdicts.run import Run

SCORES = {"rms_error_a_rad": 0.01, "coverage_of_one_sigma_a": 0.7, "log_score": 5.0}


def a_run(**differences: tuple[float, float]) -> Run:
    """A run of one joint; of each filter the differences to no filter in rms error and in log
    score, an interval of ±0.1 about them.
    """
    rows = [{"model": "none", "score": score, "mean": mean} for score, mean in SCORES.items()]
    for model, (rms, log) in differences.items():
        for score, by in zip(SCORES, (rms, 0.0, log), strict=True):
            ends = {"difference": by, "low": by - 0.1, "high": by + 0.1}
            rows.append({"model": model, "score": score, "mean": SCORES[score] + by} | ends)
    tables = {"filter_against_none": pd.DataFrame(rows)}
    return Run("lab", "paper", True, ["a"], {}, {}, tables)


def test_a_filter_that_is_worse_anywhere_beats_nothing_and_the_first_lines_say_so():
    run = a_run(additive=(0.5, -1.0), wishart=(-0.5, -1.0), additive_closed=(0.05, 0.05))
    assert verdict(run).startswith("**On lab no filter beats what the training takes alone say")
    assert verdict(run).endswith("As good as that: additive, closed loop.")
    assert first_lines([run, a_run(additive=(0.5, 0.0))]).count("**On lab") == 2


def test_a_filter_that_is_better_in_something_and_worse_in_nothing_beats_none():
    run = a_run(additive=(0.5, -1.0), wishart_closed=(0.0, 0.5), gaussian_closed=(-0.5, 0.0))
    said = verdict(run)
    assert said.startswith("On lab wishart, closed loop; gaussian, closed loop beat ")
    assert first_lines([run]) == ""


def test_no_filter_comes_first_and_closed_loops_last():
    run = a_run(additive_closed=(0.0, 1.0), additive=(0.5, -1.0))
    rows = filters_part(run).splitlines()
    assert [row.split(" | ")[0] for row in rows[-3:]] == [
        "| no filter",
        "| additive, open loop",
        "| additive, closed loop",
    ]
    assert rows[-2] == "| additive, open loop | 0.51 | 0.7 | 4 (-1 [-1.1, -0.9]) |"


def test_without_a_depth_camera_nothing_is_said():
    run = Run("arm", "paper", False, ["a"], {}, {}, {})
    assert filters_part(run) == verdict(run) == first_lines([run]) == ""
