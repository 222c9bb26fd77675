"""Of a study's rows those are told that change, with what they were and became; the others are counted as changing nothing."""

from __future__ import annotations

import pandas as pd

from pipeline.report.sensitive import Change, changes

ROWS = [
    (None, None, "mean-error", "wishart", "fails", False),
    (None, None, "mean-error", "gaussian", "fails", False),
    (None, None, "u", None, "holds", False),
    ("floor", 0.1, "mean-error", "wishart", "holds", True),
    ("floor", 0.1, "mean-error", "gaussian", "holds", True),
    ("floor", 0.1, "u", None, "no evidence", True),
    ("floor", 0.3, "mean-error", "wishart", "fails", False),
    ("floor", 0.3, "u", None, "holds", False),
]
TABLE = pd.DataFrame(ROWS, columns=["setting", "variation", "claim", "case", "holds", "changed"])


def test_changed_cases_are_told_with_before_and_after():
    found = changes(TABLE)
    change = [Change("mean-error", "wishart; gaussian", "fails", "holds"), Change("u", "", "holds", "no evidence")]
    assert found.rows == [("floor", "0.1", change)]
    assert found.unchanged == {"floor": ["0.3"]} and found.claims == 2


def test_a_study_that_changes_nothing_has_no_rows():
    found = changes(TABLE.assign(changed=False))
    assert found.rows == [] and found.unchanged == {"floor": ["0.1", "0.3"]}
