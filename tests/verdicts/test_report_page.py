"""The report: what fails with its reason, published numbers beside ours, figures in the paper's
order, and what was lost.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from pipeline.core.task import PLANE
from pipeline.verdicts import report_page
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import decide_each
from pipeline.verdicts.equations import Source, parse_items
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import ARM_OF_THE_PAPER

TEXTS = {key: f"the {key}" for key in ("where", "statement", "quantity", "reason")} | {
    "stage": "score"
}
SPREAD = TEXTS | {
    "id": "spread",
    "about": "method",
    "rule": "below",
    "limit": 0.5,
    "each": {"joint": "every"},
    "value": {"file": "metrics/motion", "key": "std_{joint}"},
    "why": {"youbot": "it mixes units"},
    "foregone": "it is constant",
}
SIGMA = TEXTS | {
    "id": "sigma",
    "where": "Sec. 4, results",
    "about": "specimen",
    "rule": "within_relative",
    "tolerance": 0.2,
    "published": 0.25,
    "parameter": "σ̂",
    "value": {"file": "metrics/fit", "key": "sigma"},
    "low": {"file": "metrics/fit", "key": "low"},
    "high": {"file": "metrics/fit", "key": "high"},
}
CLAIMS = parse_claims([SPREAD, SIGMA])


def a_run(dataset: str, synthetic: bool, joints: list[str], *spreads: float, **metrics) -> Run:
    motion = {f"std_{joint}": value for joint, value in zip(joints, spreads, strict=True)}
    metrics = {"motion": motion} | metrics
    return Run(dataset, "paper", synthetic, joints, PLANE, {}, metrics, {})


FIT = {"sigma": 0.28765, "low": 0.25, "high": 0.5}
RUNS = [
    a_run("youbot", True, ["a", "b", "c"], 0.25, 0.75, 0.1, fit=FIT),
    a_run("ur5", False, ["pan", "lift"], 0.6, 0.7, fit=FIT),
]


@pytest.fixture(scope="module")
def decided():
    return decide_each(CLAIMS, RUNS, [])


def test_the_tally_counts_by_dataset_and_by_what_claims_are_about(decided):
    text = report_page.tally(decided)
    row = "| **youbot**, synthetic recordings | 0 / 1 / 0 | 0 / 0 / 0 | 0 / 0 / 1 | 0 / 1 / 1 |"
    assert row in text


def test_what_fails_stands_with_its_cases_and_a_reason_where_one_is_written(decided):
    (row,) = report_page.not_reproduced(decided).splitlines()[2:]
    assert "**youbot** b: 0.75<br>**ur5** pan: 0.6, lift: 0.7" in row
    assert row.endswith("| it mixes units<br>not known |")
    holding = decide_each(CLAIMS, [a_run("youbot", True, ["a"], 0.1)], [])
    assert report_page.not_reproduced(holding) == ""


def test_published_numbers_stand_beside_those_of_the_arms_that_have_such_numbers(decided):
    text = report_page.published_and_ours(decided)
    assert text.endswith("| σ̂ | Sec. 4 | 0.25 | 0.2877 [0.25, 0.5] |")
    text = report_page.published_and_ours([decided[0], decided[0]])
    assert text.endswith("| σ̂ | Sec. 4 | 0.25 | 0.2877 [0.25, 0.5] | 0.2877 [0.25, 0.5] |")


def test_every_claim_has_a_sign_for_every_dataset(decided):
    rows = report_page.every_claim(decided, "of others").splitlines()[-4:-2]
    assert rows == [
        "| the statement *Can hardly fail: it is constant.* | the where | method | ✗ | ✗ |",
        f"| the statement *{ARM_OF_THE_PAPER}* | Sec. 4, results | specimen | ? | – |",
    ]


def test_figures_come_in_the_papers_order_and_then_ours():
    figure = {"kind": "figure", "place": "Sec. 4", "says": "x", "without_code": "x"}
    items = parse_items([figure | {"label": "First"}, figure | {"label": "Second"}])
    sources = {
        "First": [Source("pipeline.figures.z.draw", Path("pipeline/figures/z.py"))],
        "Second": [Source("pipeline.figures.b.draw", Path("pipeline/figures/b.py"))],
    }
    caption = "A line. More of it in mm. To look at: its height. And so on."
    captions = {
        name: {
            "title": f"Title {name}",
            "caption": caption,
            "script": f"pipeline/figures/{name}.py",
        }
        for name in ("a", "b", "z")
    }
    text = report_page.figures(captions, items, sources)
    images = [line for line in text.splitlines() if line.startswith("![")]
    assert images == [f"![Title {name}](figures/{name}.png)" for name in ("z", "b", "a")]
    assert "**Fig. 1 (First). Title z.** A line. To look at: its height. (" in text
    assert "**Not in the paper. Title a.**" in text


def test_counts_are_totals_and_no_mean_share_or_row_number_is_among_them():
    quality = pd.DataFrame(
        [
            ("camera", "cut_rows", "count", 3.0, None),
            ("camera", "gaps", "count", 0.0, None),
            ("camera", "clock_correlation", "1", None, 0.9999),
        ],
        columns=["instrument", "quantity", "unit", "total", "mean"],
    )
    metrics = {
        "recordings": {"camera_cut_rows": 3, "mean_camera_missing_share": 0.007},
        "filter_wishart": {"particle_steps_outside_the_domain": 19194, "mean_sample_size": 7},
        "wrench": {"C1_without_sigma_s_p_value": 0.55, "C1_sigma_s_clipped": 0},
    }
    run = Run("lab", "paper", False, ["a"], PLANE, {}, metrics, {"recording_quality": quality})
    assert report_page.counts(run).splitlines()[4:] == [
        "| camera | cut rows 3 |",
        "| filter of wishart | particle steps outside the domain 19,194 |",
    ]
    assert report_page.counts(RUNS[1]) == ""


def test_the_report_has_a_row_for_each_movement_also_of_one_without_a_take():
    kept = pd.DataFrame(
        [("motions", "a", 5, 2, "cut off 3"), ("motions", "b", 1, 0, None)],
        columns=["step", "recording", "found", "kept", "left_out"],
    )
    run = Run("lab", "paper", False, ["a"], PLANE, {}, {}, {"kept": kept})
    assert report_page.kept(run).splitlines()[2:] == [
        "| motions | a | 5 | 2 | cut off 3 |",
        "| motions | b | 1 | 0 |  |",
    ]
    assert report_page.kept(RUNS[1]) == ""


def test_the_page_leaves_out_what_has_no_text_and_links_the_studies(decided):
    assert "[studies](studies)" in report_page.LINKS
    parts = [("Empty", ""), ("More", report_page.LINKS)]
    page = report_page.report_page(RUNS[0], decided, "", parts)
    assert page.startswith("# Results: dataset youbot, scale paper\n")
    assert "## Empty" not in page and "## More" in page


def test_what_has_to_be_known_first_stands_before_the_tally(decided):
    page = report_page.report_page(RUNS[0], decided, "Know this.", [])
    assert page.index("Know this.") < page.index("Claims held")
