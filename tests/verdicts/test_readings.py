"""What the report says of the other readings follows the table of each run."""

from __future__ import annotations

import pandas as pd

from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import decide_each
from pipeline.verdicts.readings import readings_part
from pipeline.verdicts.run import Run


def claim(name: str, about: str) -> dict:
    return {
        "id": name,
        "where": "Sec. 1",
        "statement": f"It is {name}.",
        "about": about,
        "quantity": "size",
        "value": {"file": "metrics/motion", "key": "size"},
        "rule": "below",
        "limit": 1.0,
        "reason": "so that it can fail",
        "stage": "score",
    }


CLAIMS = parse_claims([claim("small", "method"), claim("real", "robots")])


def said(**holds: tuple[str, str, str]) -> str:
    """The text on a synthetic run in which both claims' rules hold; of each claim ``holds`` under
    the run's own reading, QR and QR transposed.
    """
    readings = ("LU", "QR", "QR transposed")
    rows = [
        {"claim": name, "reading": reading, "holds": word, "value": "", "refused": refused}
        for name, words in holds.items()
        for reading, word in zip(readings, words, strict=True)
        for refused in ["no noise; try another [q 1]" if word == "no evidence" else ""]
    ]
    tables = {"readings": pd.DataFrame(rows)} if rows else {}
    metrics = {"motion": {"size": 0.5}}
    runs = [Run("lab", "paper", True, ["a"], ["x"], {}, metrics, tables)]
    return readings_part(runs, decide_each(CLAIMS, runs, []))


def test_a_verdict_that_changes_has_a_row_with_the_runs_own_in_bold():
    text = said(small=("holds", "fails", "holds"))
    assert "| It is small. | lab | **✓** | ✗ | ✓ |" in text
    assert "| dataset | LU | QR | QR transposed |" in text
    # control: one that does not
    assert "no verdict changes." in said(small=("holds", "holds", "holds"))


def test_what_the_recordings_do_not_decide_is_named_and_no_verdict():
    text = said(small=("holds", "holds", "holds"), real=("holds", "fails", "holds"))
    assert "no verdict changes." in text and "It is real." not in text
    assert "- On lab, which does not decide them, also real." in text


def test_missing_evidence_is_no_change_and_says_why():
    text = said(small=("holds", "holds", "no evidence"))
    assert "no verdict changes." in text
    assert "- On lab, claims without evidence under QR transposed: 1 (no noise)." in text
    # nor is what the run's own reading lacks
    assert "no verdict changes." in said(small=("no evidence", "fails", "holds"))


def test_what_chance_alone_changes_is_said():
    text = said(small=("fails", "fails", "fails"))
    assert "- On lab these random numbers alone decide otherwise than above: small." in text
    assert "alone" not in said(small=("holds", "holds", "holds"))


def test_a_run_without_readings_says_the_default_alone():
    text = said()
    assert "by LU without pivoting" in text and "which-lu" in text
    assert "verdict" not in text and "tables/readings.csv" not in text
    assert "tables/readings.csv" in said(small=("holds", "holds", "holds"))
