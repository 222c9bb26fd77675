"""The report and the page of datasets state the numbers of their runs."""

import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from pipeline.core.columns import PLANE
from pipeline.core.errors import ContractError
from pipeline.evidence.table import evidence_row, evidence_table
from pipeline.verdicts import paper, report_page
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import WITHOUT_RECORDING, decide_each
from pipeline.verdicts.report_page import (
    datasets_page,
    published_and_ours,
    recordings_page,
)
from pipeline.verdicts.run import Run
from pipeline.verdicts.scores import filter_verdict, filters, result, widths
from pipeline.verdicts.wording import say

STATED = {key: f"the {key}" for key in ("where", "statement", "quantity", "reason")}
STUDY = STATED | {
    "id": "study",
    "about": "method",
    "recording": "none",
    "rule": "below",
}
STUDY |= {"published": 0.25, "parameter": "error"}
STUDY |= {"value": {"quantity": "greatest_error_of_variances"}}
STD = STATED | {"id": "std", "about": "method", "rule": "below", "limit": 0.5}
STD |= {"each": {"joint": "every"}, "value": {"quantity": "std", "joint": "{joint}"}}
STD |= {"why": {"youbot": "it mixes units"}, "where": "Sec. 1, Fig. Shown (a)"}
SIGMA = STATED | {"id": "sigma-b", "about": "specimen", "rule": "within_relative"}
SIGMA |= {"tolerance": 0.2, "published": 0.25, "parameter": "σ̂"}
SIGMA |= {"value": {"quantity": "sigma_b", "estimator": "paper"}}
ABSENT = STUDY | {"id": "absent", "value": {"quantity": "u"}}
CLAIMS = parse_claims([STUDY, STD, SIGMA, ABSENT])
FIT = {"sigma_b": 0.227, "sigma_b_paper": 0.28765, "sigma_b_moments": 0.227}
FIT |= {"sigma_b_moments_interval_low": 0.22, "sigma_b_moments_interval_high": 0.235}
GAUSSIAN = {"u_paper": 18.0, "u_moments": 1000.0, "u_moments_unbounded": 1}
GAUSSIAN |= {"noise_level_moments": 3.36}
LEVEL = {"noise_level": 3.3643, "rms_norm_of_the_inverse_jacobian": 14.5073}


def a_run(dataset: str, *stds: float, scale: str = "paper") -> Run:
    joints = ["a", "b", "c"][: len(stds)]
    rows = [
        evidence_row("std", value, joint=j)
        for j, value in zip(joints, stds, strict=True)
    ]
    rows.append(evidence_row("takes", 100, model="recorded"))
    rows.append(evidence_row("greatest_error_of_variances", 0.2))
    rows.append(evidence_row("sigma_b", FIT["sigma_b_paper"], estimator="paper"))
    metrics = {"fit_wishart": FIT, "fit_gaussian": GAUSSIAN}
    tables = {"evidence": evidence_table(rows)}
    return Run(dataset, scale, dataset == "youbot", joints, PLANE, {}, metrics, tables)


RUNS = [a_run("youbot", 0.25, 0.75, 0.1), a_run("ur5", 0.6, 0.7), a_run("mine", 0.1)]


@pytest.fixture(scope="module")
def decided():
    return decide_each(CLAIMS, RUNS, [])


FIGURES = paper.parse_items(
    [
        {
            "kind": "figure",
            "label": "Shown",
            "place": "1",
            "says": "x",
            "tests": ["a::b"],
        },
        {
            "kind": "figure",
            "label": "Photo",
            "place": "1",
            "says": "x",
            "without_code": "a photo",
        },
    ]
)
CAPTIONS = {
    name: {"title": f"The {name}", "caption": "Red. Compare."}
    for name in ("own", "more")
}


def test_claims_are_under_their_figure_with_a_verdict_a_robot_and_no_tried_out_dataset(
    decided,
):
    sources = {"Shown": [paper.Source("m.own", Path("m.py"))], "Photo": []}
    page = report_page.report_page(
        RUNS[0], RUNS, decided, CAPTIONS, FIGURES, sources, []
    )
    assert page.startswith("# Results: dataset youbot, scale paper\n")
    figure, _, others = page.partition(
        "### Fig. 1 (Shown)\n![The own](figures/own.png)\nCompare.\n"
    )
    assert "Fig. 2 (Photo): a photo." in figure
    first, _, others = others.partition("### Without a figure")
    assert first.startswith("- the statement<br>**youBot ✗ 2 of 3 · UR5 ✗ 0 of 2**\n")
    assert "- the statement<br>**no recording ✓ 0.2**\n" in others
    assert (
        "*(the paper's own arm)*<br>**youBot synthetic: rule passes 0.2877**" in others
    )
    assert "<summary>1 claims without evidence" in others
    assert "[The more](figures/more.png)" in others
    assert (
        "hold/fail: no recording: 1/0; youBot, synthetic: 0/1; UR5, real: 0/1. Syn"
        in page
    )
    assert "cannot decide 1 claims; the rule passes 1 and fails 0." in page
    assert (
        "mine ✓" not in page
        and "## Filters" not in page
        and "## Predictors" not in page
    )
    _, _, failures = page.partition("## Claims that fail\n")
    failures = failures.partition("\n\n")[0].splitlines()
    assert failures[0].endswith("b: 0.75. Reason: it mixes units.")
    assert "a: 0.6 and 1 more cases" in failures[1] and len(failures) == 2
    page = datasets_page(decided)
    assert f"| claim | mine | ur5 | youbot | {WITHOUT_RECORDING} |" in page
    assert "| std | ✓ 0.1 | ✗ 0 of 2 | ✗ 2 of 3 |  |" in page
    assert "| study |  |  |  | ✓ 0.2 |" in page


def test_the_results_of_the_readme_are_between_its_marks(decided):
    before, after = "A.\n\n<!-- results -->\n", "<!-- /results -->\n\nB.\n"
    text = report_page.readme_with_results(
        f"{before}earlier\n{after}", RUNS[0], decided
    )
    assert text.startswith(before) and text.endswith(after) and "earlier" not in text
    estimates = "0.2877 by the paper's estimator and 0.227 [0.22, 0.235] by moments"
    assert (
        f"On youbot the Wishart model's σ̂_B is {estimates}; the paper prints 0.25.\n"
        in text
    )
    with pytest.raises(ContractError, match="put them back"):
        report_page.readme_with_results(before, RUNS[0], decided)
    # a dataset without a robot has no estimates
    text = report_page.readme_with_results(
        before + after, replace(RUNS[0], metrics={}), decided
    )
    assert "σ̂_B" not in text


def test_a_trial_run_prints_no_verdict():
    runs = [a_run("youbot", 0.75, scale="smoke")]
    decided = decide_each(CLAIMS, runs, [])
    sources = {"Shown": [paper.Source("m.own", Path("m.py"))], "Photo": []}
    page = report_page.report_page(
        runs[0], runs, decided, CAPTIONS, FIGURES, sources, []
    )
    assert page.startswith("# Trial run of dataset youbot on the scale smoke")
    assert (
        "figures/own.png" in page
        and "hold/fail" not in page
        and "Published" not in page
    )
    assert not {"✓", "✗", "fails"} & {*re.split(r"\W+", page), *page}


def test_a_claim_that_another_reading_changes_has_a_row_and_missing_numbers_a_note():
    rows = {
        "claim": ["small", "small", "gap", "gap"],
        "reading": ["LU", "QR"] * 2,
        "value": "",
    }
    rows |= {
        "holds": ["holds", "fails", "holds", "no evidence"],
        "refused": "no noise; try another",
    }
    table = pd.DataFrame(rows)
    run = Run("lab", "paper", True, ["a"], PLANE, {}, {}, {"readings": table})
    text = report_page.readings([run])
    assert "| small | lab | **✓** | ✗ |" in text
    assert (
        "- lab, QR: 1 claims lack numbers (no noise)." in text and "| gap |" not in text
    )
    assert report_page.readings([RUNS[0]]) == say("default")


def test_three_estimators_are_side_by_side_and_an_unbounded_one_has_no_number(decided):
    text = published_and_ours(RUNS[0], decided)
    assert "| σ̂_B | 0.25 | 0.2877 | 0.227 [0.22, 0.235] | – |" in text
    assert "| û | – | 18 | unbounded | – |" in text
    assert "| error | 0.25 | 0.2 |" in text and "(no covariance)" not in text
    beyond = {"fit_wishart": FIT | {"sigma_b_limit_of_the_covariance": 0.25}}
    beyond["fit_wishart"]["sigma_b_likelihood"] = 1.02
    run = replace(RUNS[0], metrics=RUNS[0].metrics | beyond)
    text = published_and_ours(run, decided)
    assert "αu = " not in text
    assert "| 0.2877 (no covariance) | 0.227 [0.22, 0.235] | 1.02 (no mean) |" in text


def test_the_level_of_the_published_pair_is_beside_the_fitted_level():
    claims = [
        SIGMA | {"id": name, "published": n}
        for name, n in (("u", 18.0), ("alpha", 0.1))
    ]
    known = {"fit_gaussian": GAUSSIAN | LEVEL}
    run = replace(RUNS[0], joints=["a", "b", "c"], metrics=RUNS[0].metrics | known)
    text = published_and_ours(run, decide_each(parse_claims(claims), [run], []))
    assert "| L = α√(u² − ⟨‖J⁻¹‖²⟩) | 1.066 (of û and α̂) | – | 3.36 | – |" in text
    assert "is 3.16 times the L" in text and "α = 0.316 and αu = 5.68." in text


def test_the_caption_of_the_stds_names_the_joints_that_a_matrix_model_misses():
    stds = {"recorded": (1.0, 2.0), "wishart": (2.25, 1.0)}
    rows = [
        evidence_row("std", std, model=name, joint=joint)
        for name, both in stds.items()
        for joint, std in zip("ab", both, strict=True)
    ]
    for joint, low in {"a": 0.3, "b": -0.2}.items():
        keys = {"model": "wishart", "joint": joint, "rival": "no_noise"}
        rows.append(evidence_row("std_error", low + 0.1, low, low + 0.2, **keys))
    known = {
        "joints": ["a", "b"],
        "models": {"wishart": "wishart", "additive": "additive"},
    }
    run = replace(RUNS[1], **known, tables={"evidence": evidence_table(rows)})
    (text,) = widths(run)
    assert "2.25 times as wide as the recordings in a and 0.5 times in b; its" in text
    assert text.endswith("above the error of no noise, 1, in a.")


def test_counts_are_totals_and_no_mean_share_or_row_number_is_among_them():
    lost = [("camera", "cut_rows", "count", 3.0), ("camera", "gaps", "count", 0.0)]
    quality = pd.DataFrame(lost, columns=["instrument", "quantity", "unit", "total"])
    metrics = {
        "recordings": {"camera_cut_rows": 3, "mean_camera_missing_share": 0.007},
        "filter_wishart": {
            "particle_steps_outside_the_domain": 19194,
            "mean_sample_size": 7,
        },
    }
    page = recordings_page(
        replace(RUNS[1], metrics=metrics, tables={"recording_quality": quality})
    )
    assert page.splitlines()[-2:] == [
        "| camera | cut rows 3 |",
        "| filter of wishart | particle steps outside the domain 19,194 |",
    ]


SCORES = {
    "rms_error_a_rad": 0.01,
    "rms_error_b_rad": 0.01,
    "coverage_of_one_sigma_a": 0.7,
    "log_score": 5.0,
}


def filtered(**differences: tuple[float, float]) -> Run:
    """Return a run with the differences to the training mean by filter, in rms error of the joint
    a and in log score, with an interval of ±0.1; the rms error of b is smaller in every filter.
    """
    rows = [
        {"model": "none", "score": score, "mean": mean}
        for score, mean in SCORES.items()
    ]
    for model, (rms, log) in differences.items():
        for score, by in zip(SCORES, (rms, -0.5, 0.0, log), strict=True):
            ends = {"difference": by, "low": by - 0.1, "high": by + 0.1}
            rows.append(
                {"model": model, "score": score, "mean": SCORES[score] + by} | ends
            )
    tables = {"filter_against_none": pd.DataFrame(rows)}
    return Run("lab", "paper", True, ["a", "b"], PLANE, {}, {}, tables)


def test_filters_with_a_higher_log_score_are_named_and_the_result_states_the_differences():
    run = filtered(
        memory=(-0.5, 0.5), wishart=(-0.5, -1.0), additive_closed=(0.05, -0.75)
    )
    text = filter_verdict(run)
    assert text.startswith(
        "On lab no particle filter has a higher log score than the mean and"
    )
    assert text.endswith("has a higher log score than the training mean.")
    assert " in every joint: wishart, open loop. The linear" in text
    rows = filters(run).splitlines()[-4:]
    assert (
        rows[2]
        == "| wishart, open loop | -0.49 | -0.49 | 0.7 | – | 4 (-1 [-1.1, -0.9]) |"
    )
    higher = filter_verdict(filtered(wishart_closed=(0.0, 0.5), additive=(0.5, -1.0)))
    assert higher.startswith("On lab these particle filters have a higher log score")
    assert higher.endswith(": wishart, closed loop.")
    means = {"none": 5.0, "memory": 12.0, "wishart": 10.0, "additive": 9.0}
    rows = [
        {"steps": "all", "model": n, "score": "log_score", "mean": m}
        for n, m in means.items()
    ]
    pair = {"steps": "all", "model": "memory", "rival": "wishart", "difference": 2.0}
    run.tables["predictions"] = pd.DataFrame(rows)
    run.tables["prediction_pairs"] = pd.DataFrame([pair | {"low": 1.5, "high": 2.5}])
    assert result(run) == [
        "On lab the highest log score of a predictor is 12 nats a step (autoregressive baseline), "
        "2 [1.5, 2.5] above the highest of a matrix model.",
        "The highest log score of a particle filter is 0.75 [0.65, 0.85] below the training "
        "mean's; the linear autoregressive filter's log score is 0.5 [0.4, 0.6] above the "
        "training mean's.",
    ]


def test_the_errors_of_a_sum_of_errors_are_printed_apart():
    parts = [
        {"quantity": n, "column": "standard_error"}
        for n in ("mean_of_sigma_s", "sigma_s")
    ]
    claim = STUDY | {
        "id": "sum",
        "rule": "standard_errors",
        "limit": 2.638,
        "published": 0.3,
    }
    claim |= {"value": {"quantity": "sigma_s"}, "standard_error": parts}
    rows = [evidence_row("sigma_s", 0.25, standard_error=3e-8)]
    rows.append(evidence_row("mean_of_sigma_s", 0.26, standard_error=0.02))
    run = replace(RUNS[1], tables={"evidence": evidence_table(rows)})
    text = published_and_ours(run, decide_each(parse_claims([claim]), [run], []))
    expected = "| 0.25 [0.1972, 0.3028] (standard errors up to: sampling 0.02, which decides, and"
    assert f"{expected} quadrature 3e-08) |" in text
