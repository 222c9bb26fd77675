"""What the page says follows the numbers."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.filters import MEMORY
from pipeline.studies.filters import words
from pipeline.studies.filters.scores import (
    ALL,
    AT_REST,
    COVERAGE,
    FIRST_ORDER,
    INFORMED,
    LOG,
    RMS,
    YARDSTICK,
    placed,
)

FILTERS = ("none", "additive", "additive_closed", FIRST_ORDER, MEMORY, YARDSTICK, INFORMED)


def rows(gains: dict[str, float]) -> pd.DataFrame:
    """Scores of FILTERS for a joint, each better than no filter by its gain, with an interval of
    ±0.01.
    """
    lines = []
    for name in FILTERS:
        gain = gains.get(name, 0.0)
        for score, joint, sign in (
            (RMS, "a", -1),
            (COVERAGE, "a", 0),
            (LOG, ALL, 1),
            (AT_REST, ALL, 1),
        ):
            off = np.nan if name == "none" else sign * gain
            mean = 0.68 if score == COVERAGE else 1.0 + sign * gain
            lines.append((name, score, joint, mean, off, off - 0.01, off + 0.01))
    columns = ["filter", "score", "joint", "mean", "difference", "low", "high"]
    return pd.DataFrame(lines, columns=columns)


@pytest.fixture
def page(monkeypatch):
    """The page of the gains of each filter, at the run and at two durations."""
    monkeypatch.setattr(words.page, "figure", lambda study, name: "the figure")

    def text(gains: dict[str, float]) -> str:
        table = rows(gains)
        lasting = pd.concat(
            [
                table.assign(factor=factor, sway_time=0.01 * factor, share=0.1, left=left)
                for factor, left in ((1.0, 0.2), (5.0, 0.9))
            ]
        )
        return "\n\n".join(words.sections(placed(table), lasting, ["a"], np.eye(1) * 0.75))

    return text


def test_the_first_line_names_the_filters_that_beat_none(page):
    text = page({"additive_closed": 0.1, MEMORY: 0.2, INFORMED: 0.4})
    assert text.startswith("**Of the models' filters “additive, closed loop” beats no filter**")
    assert "loses in nothing and gains in rms error of a and log score" in text
    assert "“linear, takes' memory” beats it" in text
    assert "-0.1 [-0.11, -0.09] 25%" in text
    assert "a -0.25" in text


def test_a_closed_loop_that_loses_is_told_where(page):
    text = page({"additive_closed": -0.1, INFORMED: 0.4})
    assert text.startswith("**Of the models' filters none beats no filter**")
    assert "loses in rms error of a and log score and gains in nothing" in text
    assert (
        "**additive, closed loop**: worse than no filter in log score at the factors 1, 5" in text
    )
    assert "better in 0 of 1 rms errors" in text
    # control: one that gains
    assert "better in 1 of 1 rms errors" in page({"additive_closed": 0.1})


def test_the_goal_is_told_by_duration(page):
    text = page({MEMORY: 0.1, INFORMED: 0.4})
    line = next(line for line in text.splitlines() if line.startswith("- **linear, takes'"))
    assert "worse than no filter nowhere" in line and "coverage 0.68 to 0.68;" in line
    assert "log score at rest +0.1 to +0.1" in line


def test_a_dataset_without_a_laboratory_says_so():
    assert "no synthetic laboratory" in words.missing()[0]
