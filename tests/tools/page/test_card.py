"""The card of a dataset answers the seven groups of questions from what it is given, for a
synthetic dataset and for a recorded one.
"""

from __future__ import annotations

import re
from dataclasses import replace
from math import nan

import pandas as pd
import pytest

from pipeline.tools.page.card import Facts, card
from pipeline.tools.page.option_comments import Option, Part

SECTIONS = [
    "Motivation",
    "Composition",
    "Collection process",
    "Preprocessing, cleaning, labelling",
    "Uses",
    "Distribution",
    "Maintenance",
]


@pytest.fixture
def facts() -> Facts:
    takes = pd.DataFrame(
        {
            "take": ["a", "b", "c"],
            "part": ["training", "training", "test"],
            "left_out": [False, True, False],
        }
    )
    quality = pd.DataFrame(
        [
            ["a tracker", "gaps", "count", 9.0, nan, 2.0, 4.0],
            ["a tracker", "share", "1", nan, 3.0, 2.0, 4.0],
        ],
        columns=["instrument", "quantity", "unit", "total", "mean", "least", "greatest"],
    )
    about = {"subject": "an arm", "source": "a laboratory", "licence": "CC0"}
    part = Part(
        "tracker", "How it errs.", [Option("tracker.noise", 0.125, "m, white | assumed", 0.5)]
    )
    return Facts(
        "lab",
        "smoke",
        7,
        about,
        {"data/raw/lab/x": (1234567, 8)},
        takes,
        quality,
        125.0,
        64,
        15.0,
        ["C1", "C2"],
        11.0,
        [part],
    )


def test_every_group_of_questions_is_answered_in_their_order(facts):
    for each in (facts, replace(facts, laboratory=None)):
        page = card(each)
        assert re.findall(r"^## (.+)$", page, re.MULTILINE) == SECTIONS
        for _, answer in zip(SECTIONS, page.split("\n## ")[1:], strict=True):
            assert len(answer.split("\n", 1)[1].strip()) > 40
        assert page.count("\n\n## ") == len(SECTIONS) and page.endswith(".\n")


def test_its_numbers_are_those_it_is_given(facts):
    page = card(facts)
    for text in (
        "| training | 2 |",
        "| test | 1 |",
        "64 steps at 125 per second",
        "at 15 per second",
        "2 arrangements (C1, C2), of each 11 s",
        "| `data/raw/lab/x` | 8 | 1,234,567 |",
        "| a tracker | gaps | count | 9 | – | 2 | 4 |",
        "| a tracker | share | 1 | – | 3 | 2 | 4 |",
        "leaves out: b.",
        "from the seed 7;",
        r"| `tracker.noise` | 0.125 (laboratory's own: 0.5) | m, white \| "
        r"assumed |",
        "Licence: CC0.",
    ):
        assert text in page, text
    assert set(
        re.findall(r"(?<![\w.`])\d+(?:\.\d+)?(?![\w.])", card(replace(facts, laboratory=[])))
    ) <= {
        "2",
        "1",
        "64",
        "125",
        "15",
        "11",
        "8",
        "9",
        "3",
        "4",
        "7",
        "2021",
        "1,234,567",
        "234",
        "567",
    }


def test_of_recordings_nothing_is_said_that_holds_for_the_laboratory_alone(facts):
    page = card(replace(facts, laboratory=None, depth_rate=None, configurations=[], stored={}))
    for word in (
        "seed",
        "laboratory's own",
        "simulation",
        "truth",
        "depth images",
        "N of force",
        "dvc.lock",
    ):
        assert word not in page, word
    assert "a laboratory" in page and "data/raw/lab/dataset.yaml" in page


def test_what_is_missing_is_an_error_and_no_gap_in_a_sentence(facts):
    with pytest.raises(Exception, match="licence"):
        card(replace(facts, about={"subject": "an arm", "source": "a laboratory"}))
