"""What is said of a matrix model's advantage is what its paired differences are, and against the
strongest rival.
"""

from __future__ import annotations

import pandas as pd
import pytest

from pipeline.studies.baselines.words import NOTHING, answer, line, scores_table
from pipeline.verdicts.run import Run

RIVALS = ["additive", "scaled", "student"]
GAP = float("nan")


def said(**differences: tuple[float, float, float]) -> str:
    rows = [("moving", "gaussian", rival, *values) for rival, values in differences.items()]
    columns = ["steps", "model", "rival", "difference", "low", "high"]
    return line("gaussian", pd.DataFrame(rows, columns=columns), RIVALS)


@pytest.mark.parametrize(
    ("strongest", "left"),
    [
        ((0.2, 0.1, 0.3), "its advantage is left"),
        ((-0.2, -0.3, -0.1), "nothing is left"),
        ((-0.02, -0.1, 0.06), "nothing certain is left"),
        ((0.02, float("nan"), float("nan")), "nothing certain is left"),
    ],
)
def test_the_strongest_rival_decides_what_is_left(strongest, left):
    text = said(additive=(0.6, 0.5, 0.7), scaled=strongest, student=(0.3, 0.2, 0.4))
    assert f": {left}." in text
    assert (
        "+0.6 [+0.5, +0.7] against additive" in text
        and "against scaled" in text
        and "against student" not in text
    )


def test_the_first_rival_is_named_once_where_it_is_the_strongest():
    text = said(additive=(0.1, 0.05, 0.15), scaled=(0.6, 0.5, 0.7))
    assert text.count("against") == 1 and "its advantage is left" in text


def test_a_model_without_a_score_says_so():
    gap = float("nan")
    assert "gaussian: no score to compare." in said(additive=(gap, gap, gap))


SCORES = pd.DataFrame(
    [
        ("all", "additive", "log_score", 11.25, GAP, GAP, GAP),
        ("all", "gaussian", "log_score", 12.0, 0.75, 0.5, 1.0),
        ("all", "wishart", "log_score", 10.0, -1.25, -1.5, -1.0),
        ("all", "scaled", "log_score", GAP, GAP, GAP, GAP),
        ("all", "gaussian", "nees", 3.0, 99.0, 98.0, 100.0),
        ("moving", "additive", "log_score", 9.0, GAP, GAP, GAP),
        ("moving", "gaussian", "log_score", 9.1, 0.1, -0.1, 0.3),
        ("moving", "wishart", "log_score", 9.1, 0.1, GAP, GAP),
    ],
    columns=["steps", "model", "score", "mean", "difference", "low", "high"],
)
KINDS = {"additive": "additive", "gaussian": "gaussian", "scaled": "scaled"}


def run(**tables: pd.DataFrame) -> Run:
    return Run("lab", "paper", False, ["a"], ["x", "z", "phi"], KINDS, {}, tables)


def test_differences_and_their_intervals_stand_by_steps_and_model():
    lines = scores_table(run(model_scores=SCORES)).splitlines()
    assert lines[0] == "| steps | additive | gaussian | wishart | scaled |"
    assert lines[2:] == [
        "| all | 11.2 | +0.75 [+0.5, +1] | -1.25 [-1.5, -1] | – |",
        "| moving | 9 | +0.1 [-0.1, +0.3] | +0.1 | – |",
    ]


def test_a_dataset_without_scores_says_so():
    assert scores_table(run()) == NOTHING and "no score to compare" in answer(run())


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.1, 0.3, "gaussian beats every model without a matrix, on all groups"),
        (-0.3, -0.1, "nowhere, and loses to scaled on 1 of 1 groups"),
        (-0.1, 0.1, "nowhere, and loses to none on 0 of 1 groups"),
    ],
)
def test_the_answer_is_what_the_strongest_rival_leaves(low, high, text):
    columns = ["steps", "model", "rival", "difference", "low", "high"]
    rows = [("all", "gaussian", "additive", 1.0, 0.9, 1.1)]
    rows.append(("all", "gaussian", "scaled", (low + high) / 2, low, high))
    assert text in answer(run(log_score_differences=pd.DataFrame(rows, columns=columns)))
