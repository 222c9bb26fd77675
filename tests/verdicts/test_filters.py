"""What the report says of the filters: a row each, and a verdict that follows the intervals."""

from __future__ import annotations

import pandas as pd
import pytest

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
    return Run("lab", "paper", True, ["a"], ["x", "z", "phi"], {}, {}, tables)


BEATS, LOSES, EQUALS = (-0.5, 0.5), (-0.5, -0.5), (0.0, 0.0)


def test_a_filter_that_is_worse_anywhere_beats_nothing_and_the_first_lines_say_so():
    run = a_run(
        memory=BEATS, additive=(0.5, -1.0), wishart=(-0.5, -1.0), additive_closed=(0.05, 0.05)
    )
    said = verdict(run)
    assert said.startswith("**On lab no model's filter beats what the training takes alone say")
    assert "worse log score: wishart, open loop. As good as that: additive, closed loop." in said
    assert said.endswith("own spread and memory beats it.")
    other = a_run(memory=LOSES, additive=(0.5, 0.0))
    assert first_lines([run, other]).count("**On lab") == 2


@pytest.mark.parametrize(
    ("differences", "fares"),
    [(BEATS, "beats it"), (LOSES, "is worse in some score"), (EQUALS, "is as good")],
)
def test_the_linear_filter_is_held_against_none_by_its_own_intervals(differences, fares):
    said = verdict(a_run(memory=differences, additive=(0.5, -1.0)))
    assert said.startswith("**On lab no model's filter beats ") and "each is worse" in said
    assert said.endswith(f"The linear filter of the takes' own spread and memory {fares}.")


def test_a_filter_that_is_better_in_something_and_worse_in_nothing_beats_none():
    run = a_run(
        memory=BEATS, additive=(0.5, -1.0), wishart_closed=(0.0, 0.5), gaussian_closed=(-0.5, 0.0)
    )
    beating = "wishart, closed loop; gaussian, closed loop beat "
    assert verdict(run).startswith(f"On lab of the models' filters {beating}")
    assert first_lines([run]) == ""


def test_no_filter_comes_first_then_the_linear_one_and_closed_loops_last():
    run = a_run(additive_closed=(0.0, 1.0), additive=(0.5, -1.0), memory=BEATS)
    rows = filters_part(run).splitlines()
    assert [row.split(" | ")[0] for row in rows[-4:]] == [
        "| no filter",
        "| linear, takes' memory",
        "| additive, open loop",
        "| additive, closed loop",
    ]
    assert rows[-2] == "| additive, open loop | 0.51 | 0.7 | 4 (-1 [-1.1, -0.9]) |"


def test_without_a_depth_camera_nothing_is_said():
    run = Run("arm", "paper", False, ["a"], ["x", "z", "phi"], {}, {}, {})
    assert filters_part(run) == verdict(run) == first_lines([run]) == ""
