"""Models stand beside the first one with their differences, and a whole interval on one side of zero is marked."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.audit.comparison import FILTERED, NOTHING, compare_models, comparison_section
from pipeline.audit.run import Run

GAP = np.nan
COLUMNS = ["steps", "model", "score", "mean", "difference", "low", "high"]
ONE_STEP = pd.DataFrame(
    [
        ("all", "additive", "log_score", 11.25, GAP, GAP, GAP),
        ("all", "gaussian", "log_score", 12.0, 0.75, 0.5, 1.0),
        ("all", "wishart", "log_score", 10.0, -1.25, -1.5, -1.0),
        ("all", "timing", "log_score", GAP, GAP, GAP, GAP),
        ("all", "gaussian", "nees", 3.0, 99.0, 98.0, 100.0),
        ("moving", "additive", "log_score", 9.0, GAP, GAP, GAP),
        ("moving", "gaussian", "log_score", 9.1, 0.1, -0.1, 0.3),
        ("moving", "wishart", "log_score", 9.1, 0.1, GAP, GAP),
    ],
    columns=COLUMNS,
)
FILTER = pd.DataFrame([("additive", "log_score", 8.0, GAP, GAP, GAP)], columns=COLUMNS[1:])


def run(**tables: pd.DataFrame) -> Run:
    return Run("lab", "paper", False, {}, {}, tables)


def test_differences_and_their_intervals_by_steps_and_model():
    found = compare_models(run(one_step_scores=ONE_STEP, filter_comparison=FILTER))
    assert found.models == ["additive", "gaussian", "wishart", "timing"]
    assert found.steps == ["all", "moving", FILTERED]
    assert found.texts == [
        ["11.25", "+0.75 [+0.5, +1]", "-1.25 [-1.5, -1]", "–"],
        ["9", "+0.1 [-0.1, +0.3]", "+0.1", "–"],
        ["8", "–", "–", "–"],
    ]
    assert found.better == [[None, True, False, None], [None, None, None, None], [None, None, None, None]]


def test_no_other_score_is_taken_for_the_log_score():
    assert "+99" not in comparison_section([compare_models(run(one_step_scores=ONE_STEP))])


def test_a_dataset_without_scores_says_so():
    assert NOTHING in comparison_section([compare_models(run())])
    assert "| steps | additive |" in comparison_section([compare_models(run(filter_comparison=FILTER))])
