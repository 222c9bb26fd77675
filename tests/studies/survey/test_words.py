"""The page says which claims turn along what nobody published, and at which levels."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from pipeline.studies.survey.words import sections

LEVELS = [
    ("base condition", ""),
    ("trajectory", "slow"),
    ("trajectory", "a tenth at rest"),
    ("trajectory", "six tenths at rest"),
    ("lasting", "0.15"),
    ("lasting", "10"),
]
COUNTS = {  # claim, about → holds and fails of 2 conditions at each level
    ("turns", "method"): [(2, 0), (0, 2), (2, 0), (1, 1), (0, 2), (2, 0)],
    ("stays", "method"): [(0, 2), (2, 0), (0, 2), (0, 2), (0, 2), (0, 2)],
    ("moves", "robots"): [(0, 2), (0, 2), (0, 2), (0, 2), (0, 0), (2, 0)],
}


@pytest.fixture
def page(tmp_path: Path) -> str:
    """Of the survey small, with the counts COUNTS."""
    rows = [
        {"study": "motion", "factor": factor, "level": level, "claim": claim, "about": about}
        | {"conditions": 2, "holds": holds, "fails": fails}
        for (claim, about), counts in COUNTS.items()
        for (factor, level), (holds, fails) in zip(LEVELS, counts, strict=True)
    ]
    folder = tmp_path / "small"
    folder.mkdir()
    pd.DataFrame(rows).to_csv(folder / "verdicts.csv", index=False)
    pd.DataFrame({"agrees": [True, False]}).to_csv(folder / "base_condition.csv", index=False)
    (folder / "cost.json").write_text(json.dumps({"conditions": 12, "cpu_seconds": 3.0}))
    return "\n\n".join(sections(tmp_path, "no cameras"))


def rows_after(page: str, title: str) -> list[str]:
    """The rows of the table after the paragraph that begins with ``title``, without the header."""
    return page.split(f"**{title}")[1].split("\n\n")[1].splitlines()[2:]


def test_the_claims_that_turn_along_a_free_choice_stand_with_every_level(page):
    assert "and rattling.** 2 of 3 claims turn." in page
    assert rows_after(page, "How long") == [
        "| turns | all | none | all |",
        "| moves * | none | no evidence | all |",
    ]


def test_of_the_trajectories_only_those_with_another_rest_tell_of_it(page):
    assert "longer rests.** 1 of 3 claims turn." in page
    assert rows_after(page, "The share of rest") == ["| turns | all | all | some |"]
    # control: another pace turns more, and stands with all other factors
    assert "| stays | none | trajectory (slow) |" in page


def test_what_a_survey_does_not_vary_is_not_spoken_of(page):
    assert "power of the speed" not in page
