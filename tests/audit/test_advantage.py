"""What is said of a matrix model's advantage is what its paired differences are, and against the strongest rival."""

from __future__ import annotations

import pandas as pd
import pytest

from pipeline.audit.advantage import advantage_section

RIVALS = ["additive", "scaled", "student"]


def section(**differences: tuple[float, float, float]) -> str:
    rows = [("moving", "gaussian", rival, *values) for rival, values in differences.items()]
    return advantage_section(
        "youbot", pd.DataFrame(rows, columns=["steps", "model", "rival", "difference", "low", "high"]), ["gaussian"], RIVALS
    )


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
    text = section(additive=(0.6, 0.5, 0.7), scaled=strongest, student=(0.3, 0.2, 0.4))
    assert f": {left}." in text
    assert "+0.6 [+0.5, +0.7] against additive" in text and "against scaled" in text and "against student" not in text


def test_the_first_rival_is_named_once_where_it_is_the_strongest():
    text = section(additive=(0.1, 0.05, 0.15), scaled=(0.6, 0.5, 0.7))
    assert text.count("against") == 1 and "its advantage is left" in text


def test_a_model_without_a_score_says_so():
    gap = float("nan")
    assert "gaussian: no score to compare." in section(additive=(gap, gap, gap))
