"""The report and the page of datasets state the numbers of their runs."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from pipeline.core.columns import PLANE
from pipeline.core.errors import ContractError
from pipeline.verdicts import report_page
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import WITHOUT_RECORDING, decide_each
from pipeline.verdicts.paper import Source, parse_items
from pipeline.verdicts.report_page import datasets_page, recordings_page
from pipeline.verdicts.run import Run
from pipeline.verdicts.scores import filter_verdict, filters, result
from pipeline.verdicts.wording import TEXTS, case_text, number

STATED = {key: f"the {key}" for key in ("where", "statement", "quantity", "reason")}
STUDY = STATED | {"id": "study", "about": "method", "recording": "none", "rule": "below"}
STUDY |= {"published": 0.25, "parameter": "error"}
STUDY |= {"value": {"file": "metrics/wrench", "key": "error"}}
STD = STATED | {"id": "std", "about": "method", "rule": "below", "limit": 0.5}
STD |= {"each": {"joint": "every"}, "value": {"file": "metrics/motion", "key": "std_{joint}"}}
STD |= {"why": {"youbot": "it mixes units"}}
SIGMA = STATED | {"id": "sigma-b", "about": "specimen", "rule": "within_relative"}
SIGMA |= {"tolerance": 0.2, "published": 0.25, "parameter": "σ̂"}
SIGMA |= {"value": {"file": "metrics/fit_wishart", "key": "sigma_b_paper"}}
OWN = STD | {"id": "own", "source": "project", "where": ""}
CLAIMS = parse_claims([STUDY, STD, SIGMA, OWN])
FIT = {"sigma_b": 0.227, "sigma_b_paper": 0.28765, "sigma_b_moments": 0.227}
FIT |= {"sigma_b_moments_interval_low": 0.22, "sigma_b_moments_interval_high": 0.235}
GAUSSIAN = {"u_paper": 18.0, "u_moments": 1000.0, "u_moments_unbounded": 1}


def a_run(dataset: str, *stds: float, scale: str = "paper", takes: int = 100) -> Run:
    joints = ["a", "b", "c"][: len(stds)]
    motion = {f"std_{joint}": value for joint, value in zip(joints, stds, strict=True)}
    metrics = {"motion": motion | {"recorded_takes": takes}, "wrench": {"error": 0.2}}
    metrics |= {"fit_wishart": FIT, "fit_gaussian": GAUSSIAN}
    return Run(dataset, scale, dataset == "youbot", joints, PLANE, {}, metrics, {})


RUNS = [a_run("youbot", 0.25, 0.75, 0.1), a_run("ur5", 0.6, 0.7), a_run("mine", 0.1)]


@pytest.fixture(scope="module")
def decided():
    return decide_each(CLAIMS, RUNS, [])


def test_the_first_table_has_a_column_a_robot_and_no_tried_out_dataset(decided):
    page = report_page.report_page(RUNS[0], RUNS, decided, {"Empty": "", "Ours": "x"})
    assert page.startswith("# Results: dataset youbot, scale paper\n")
    assert f"| claim | {WITHOUT_RECORDING} | youBot, synthetic | UR5, real |" in page
    assert "| the statement | ✓ 0.2 |  |  |" in page
    assert "| the statement |  | ✗ 2/3 | ✗ 0/2 |" in page
    assert "| the statement *(the paper's own arm)* |  | ? 0.2877 | – |" in page
    assert page.index("the project's own claim") > page.index("the paper's own arm")
    assert "hold/fail: no recording: 1/0; youBot, synthetic: 0/1; UR5, real: 0/1.\n" in page
    assert "| mine" not in page and "## Empty" not in page and "## Ours" in page
    own = report_page.report_page(RUNS[2], RUNS, decided, {})
    assert f"| claim | {WITHOUT_RECORDING} | mine | youBot, synthetic | UR5, real |" in own
    # every dataset stands on a page of its own
    page = datasets_page(decided)
    assert f"| claim | mine | ur5 | youbot | {WITHOUT_RECORDING} |" in page
    assert "| std | ✓ | ✗ | ✗ |  |" in page and "| study |  |  |  | ✓ |" in page


def test_the_results_of_the_readme_stand_between_its_marks(decided):
    before, after = "A.\n\n<!-- results -->\n", "<!-- /results -->\n\nB.\n"
    text = report_page.readme_with_results(f"{before}earlier\n{after}", RUNS[0], decided)
    assert text.startswith(before) and text.endswith(after) and "earlier" not in text
    assert "no recording: 1 / 0; youBot, synthetic: 0 / 1; UR5, real: 0 / 1.\n" in text
    assert "σ̂_B is 0.227; printed is 0.25.\n" in text
    assert report_page.readme_with_results(text, RUNS[0], decided) == text
    with pytest.raises(ContractError, match="put them back"):
        report_page.readme_with_results(before, RUNS[0], decided)


def test_a_trial_run_says_so_and_prints_no_verdict():
    runs = [a_run("youbot", 0.75, scale="smoke")]
    page = report_page.report_page(runs[0], runs, decide_each(CLAIMS, runs, []), {})
    assert page.startswith("# A trial run on the scale smoke, whose numbers decide nothing")
    assert not {"✓", "✗", "Claims", "hold"} & {*page.replace(":", " ").split()}
    assert {"hold", "fail"} & {*report_page.summary_numbers(runs[0], [])} == set()


def test_every_failure_has_its_test_first_case_and_reason(decided):
    lines = report_page.failures(RUNS[0], decided).splitlines()
    failing = [f"- **{claim}** on {name}" for claim in ("std", "own") for name in ("youbot", "ur5")]
    assert [line.partition(":")[0] for line in lines] == failing
    assert lines[0].endswith("b: 0.75. Reason: it mixes units.")
    assert "a: 0.6 and 1 more cases" in lines[1]


@pytest.mark.parametrize(("takes", "cell"), [(100, "0.227 [0.22, 0.235]"), (4, "0.227")])
def test_three_estimators_stand_side_by_side_and_an_unbounded_one_has_no_number(takes, cell):
    runs = [a_run("youbot", 0.1, takes=takes)]
    text = report_page.published_and_ours(runs[0], decide_each(CLAIMS, runs, []))
    assert f"| σ̂_B | 0.25 | 0.2877 | {cell} | – |" in text
    assert "| û | – | 18 | unbounded | – |" in text
    assert "| error | 0.25 | 0.2 |" in text
    assert "no covariance" not in text
    limit = {"sigma_b_limit_of_the_covariance": 0.25}
    runs[0].metrics["fit_wishart"] = runs[0].metrics["fit_wishart"] | limit
    text = report_page.published_and_ours(runs[0], decide_each(CLAIMS, runs, []))
    assert f"| σ̂_B | 0.25 | 0.2877, no covariance | {cell} | – |" in text


def test_a_case_shows_why_it_is_not_decided():
    place = {"file": "metrics/motion"}
    follows = STD | {"rule": "follows", "limit": None}
    follows |= {key: place | {"key": f"{key}_{{joint}}"} for key in ("threshold", "power")}
    run = a_run("ur5", 0.6)
    run.metrics["motion"].update(threshold_a=0.3, power_a=0.12)
    (claim,) = parse_claims([follows])
    ((case,),) = (v.cases for v in decide_each([claim], [run], [])[0].verdicts)
    assert case_text(case) == "a: 0.6 (limit 0.3), power 0.12"
    forced = parse_claims([STD | {"by": "construction", "because": "so"}])
    assert report_page.verdict_cell(decide_each(forced, [run], [])[0].verdicts[0]) == "="
    assert report_page.statement(forced[0]) == "the statement *(by construction)*"
    numbers = map(number, (float("nan"), 1234567.0, 0.123456))
    assert [*numbers] == ["–", "1,234,567", "0.1235"]


def test_figures_come_in_the_papers_order_and_then_ours():
    figure = {"kind": "figure", "place": "Sec. 4", "says": "x", "without_code": "x"}
    items = parse_items([figure | {"label": "First"}, figure | {"label": "Second"}])
    sources = {
        label: [Source(f"pipeline.figures.motion.{name}", Path("pipeline/figures/motion.py"))]
        for label, name in (("First", "z"), ("Second", "b"))
    }
    caption = "A line. More of it in mm. To look at: its height. And so on."
    captions = {name: {"title": name, "caption": caption} for name in ("a", "b", "z")}
    assert report_page.figures(captions, items, sources).splitlines() == [
        "- **Fig. 1 (First).** To look at: its height.",
        "  ![z](figures/z.png)",
        "- **Fig. 2 (Second).** To look at: its height.",
        "  ![b](figures/b.png)",
        "- Not in the paper: [a](figures/a.png).",
    ]


def test_counts_are_totals_and_no_mean_share_or_row_number_is_among_them():
    quality = pd.DataFrame(
        [("camera", "cut_rows", "count", 3.0), ("camera", "gaps", "count", 0.0)],
        columns=["instrument", "quantity", "unit", "total"],
    )
    metrics = {
        "recordings": {"camera_cut_rows": 3, "mean_camera_missing_share": 0.007},
        "filter_wishart": {"particle_steps_outside_the_domain": 19194, "mean_sample_size": 7},
        "wrench": {"C1_without_sigma_s_p_value": 0.55, "C1_sigma_s_clipped": 0},
    }
    kept = pd.DataFrame(
        [("motions", "a", 5, 2, "cut off 3"), ("motions", "b", 1, 0, None)],
        columns=["step", "recording", "found", "kept", "left_out"],
    )
    tables = {"recording_quality": quality, "kept": kept}
    run = Run("lab", "paper", False, ["a"], PLANE, {}, metrics, tables)
    page = recordings_page(run)
    lost = ["| camera | cut rows 3 |"]
    lost.append("| filter of wishart | particle steps outside the domain 19,194 |")
    assert page.splitlines()[-2:] == lost
    assert "| motions | b | 1 | 0 |  |" in page
    assert recordings_page(RUNS[1]) == "# Recordings of dataset ur5\n"


SCORES = {"rms_error_a_rad": 0.01, "coverage_of_one_sigma_a": 0.7, "log_score": 5.0}


def filtered(**differences: tuple[float, float]) -> Run:
    """A run of one joint; by filter the differences to the training mean in rms error and in log
    score, with an interval of ±0.1.
    """
    rows = [{"model": "none", "score": score, "mean": mean} for score, mean in SCORES.items()]
    for model, (rms, log) in differences.items():
        for score, by in zip(SCORES, (rms, 0.0, log), strict=True):
            ends = {"difference": by, "low": by - 0.1, "high": by + 0.1}
            rows.append({"model": model, "score": score, "mean": SCORES[score] + by} | ends)
    tables = {"filter_against_none": pd.DataFrame(rows)}
    return Run("lab", "paper", True, ["a"], PLANE, {}, {}, tables)


def test_the_filters_with_a_higher_log_score_are_named_and_the_rows_have_an_order():
    run = filtered(memory=(-0.5, 0.5), wishart=(-0.5, -1.0), additive_closed=(0.05, 0.05))
    text = filter_verdict(run)
    assert text.startswith("On lab no particle filter has a higher log score than the mean and")
    assert "smaller rms error than the training mean in every joint: wishart, open loop." in text
    assert text.endswith("has a higher log score than the training mean.")
    lower = filtered(memory=(0.0, 0.0), wishart=(0.0, -1.0))
    assert "has no higher log score" in filter_verdict(lower)
    higher = filter_verdict(filtered(wishart_closed=(0.0, 0.5), additive=(0.5, -1.0)))
    assert higher.startswith("On lab these particle filters have a higher log score")
    assert higher.endswith(": wishart, closed loop.")
    rows = filters(run).splitlines()[-4:]
    order = ["training mean", "autoregressive, linear filter"]
    order += ["wishart, open loop", "additive, closed loop"]
    assert [row.split(" | ")[0].removeprefix("| ") for row in rows] == order
    assert rows[2] == "| wishart, open loop | -0.49 | 0.7 | 4 (-1 [-1.1, -0.9]) |"
    assert filters(RUNS[0]) == filter_verdict(RUNS[0]) == ""


@pytest.mark.parametrize(
    ("best", "matrix", "expected"),
    [
        ("memory", "wishart", ("autoregressive baseline", "matrix model")),
        ("wishart", "memory", ("Wishart matrix model", "baseline")),
    ],
)
def test_the_result_names_predictor_and_filter_with_numbers_in_at_most_25_words(
    best, matrix, expected
):
    run = filtered(memory=(-0.5, 0.5), wishart=(-0.5, -1.0), additive_closed=(0.05, -0.75))
    means = {"none": 5.0, best: 12.0, matrix: 10.0, "scaled_full": 9.0}
    rows = [{"steps": "all", "model": n, "score": "log_score", "mean": m} for n, m in means.items()]
    pair = {"steps": "all", "model": best, "rival": matrix, "difference": 2.0}
    run.tables["predictions"] = pd.DataFrame(rows)
    run.tables["prediction_pairs"] = pd.DataFrame([pair | {"low": 1.5, "high": 2.5}])
    predictor, loops = result(run)
    score = "The highest log score of a predictor is 12 nats a step"
    assert predictor == "{} ({}), 2 [1.5, 2.5] above the best {}'s.".format(score, *expected)
    assert loops == (
        "The best particle filter has a log score 0.75 [0.65, 0.85] below the training mean's, "
        "the linear autoregressive filter 0.5 [0.4, 0.6] above it."
    )
    assert max(len(text.split()) for text in (predictor, loops)) <= 25
    assert result(RUNS[0]) == []


def read_under(**holds: tuple[str, str]) -> str:
    rows = [
        {"claim": name, "reading": reading, "holds": word, "value": "", "refused": refused}
        for name, words in holds.items()
        for reading, word in zip(("LU", "QR"), words, strict=True)
        for refused in ["no noise; try another [q 1]" if word == "no evidence" else ""]
    ]
    tables = {"readings": pd.DataFrame(rows)} if rows else {}
    return report_page.readings([Run("lab", "paper", True, ["a"], PLANE, {}, {}, tables)])


def test_a_claim_that_another_reading_changes_has_a_row_and_missing_numbers_a_note():
    text = read_under(
        small=("holds", "fails"), same=("fails", "fails"), gap=("holds", "no evidence")
    )
    assert "| small | lab | **✓** | ✗ |" in text and "| same |" not in text
    assert "- lab, QR: 1 claims lack numbers (no noise)." in text and "| gap |" not in text
    assert read_under() == read_under(same=("holds", "holds")) == TEXTS["report"]["default"]
