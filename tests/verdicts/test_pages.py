"""The report and the page of datasets state the numbers of their runs."""

import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from pipeline.core.columns import PLANE
from pipeline.core.errors import ContractError
from pipeline.evidence.table import evidence_row, evidence_table
from pipeline.verdicts import open_choices, paper, report_page
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import decide_each
from pipeline.verdicts.estimates import published_and_ours
from pipeline.verdicts.report_page import (
    Drawn,
    Edition,
    datasets_page,
    recordings_page,
    speeds,
)
from pipeline.verdicts.run import Run
from pipeline.verdicts.scores import (
    filter_verdict,
    filters,
    result,
    widths,
    without_random_matrix,
)
from pipeline.verdicts.tally import Group, case_count, groups_of, tally
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
VARIES = STATED | {"id": "varies", "about": "robots", "rule": "varies", "margin": 0.2}
VARIES |= {"each": {"joint": "every"}}
for key, quantity in {
    "value": "std_variation",
    "than": "std_variation_limits",
    "difference": "ln_std_by_speed",
    "power": "ln_std_by_speed_power",
}.items():
    place = {"quantity": quantity, "model": "recorded", "joint": "{joint}"}
    VARIES[key] = place | ({"column": "low"} if key == "than" else {})
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


def groups(*runs: Run, claims=CLAIMS) -> list[Group]:
    return groups_of(runs, decide_each(claims, runs, []))


@pytest.fixture(scope="module")
def grouped() -> list[Group]:
    return groups(*RUNS)


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
    ],
)
CAPTIONS = {
    name: {"title": f"The {name}", "caption": "Red. Compare."}
    for name in ("own", "more")
}


SOURCES = {"Shown": [paper.Source("m.own", Path("m.py"))], "Photo": []}
DRAWN = Drawn(CAPTIONS, FIGURES, SOURCES)


def test_claims_are_under_their_figure_with_the_verdict_of_every_group(grouped):
    page = report_page.report_page(
        RUNS[0],
        grouped,
        tally(grouped),
        DRAWN,
        [],
        Edition("1.2", 2017),
    )

    assert page.startswith("# Matrix-Based Characterization")
    assert "Dataset youbot, scale paper, version 1.2, seed 2017." in page
    title = "### The own (Fig. 1)\n![Fig. 1](figures/own.png)\nCompare.\n"
    before, _, after = page.partition(title)
    assert "Fig. 2: a photo." in before
    under_figure, _, without = after.partition("### Claims without a figure")
    verdicts = [
        "youBot synthetic ✗ fails (2 of 3); reason: it mixes units (youbot)",
        "UR5 ✗ fails (0 of 2)",
        "mine ✓ holds (0.1)",
    ]
    line = f"- the statement<br>**{' · '.join(verdicts)}**\n"
    assert under_figure.startswith(line)
    assert "- the statement<br>**no recording ✓ holds (0.2)**\n" in without
    specimen = "*(the paper's own arm)*<br>**youBot synthetic holds (0.2877)**"
    assert specimen in without
    assert "1 claims without evidence in these datasets: absent." in without
    assert "[The more](figures/more.png)" in without
    assert "| youBot, synthetic (`youbot`) | 0 | 0 | 1: std | 0 |" in page
    assert "| UR5, real (`ur5`) | 0 | 0 | 1: std | 0 |" in page
    assert "## Predictors" not in page


def test_the_page_of_datasets_has_each_verdict_and_a_sentence_where_they_differ(
    grouped,
):
    page = datasets_page(grouped, tally(grouped))
    assert "| claim | no recording | youbot | ur5 | mine |" in page
    assert "| std |  | ✗ 2 of 3 | ✗ 0 of 2 | ✓ 0.1 |" in page
    assert "| study | ✓ 0.2 |  |  |  |" in page

    sentence = "Holds: mine; fails: youBot synthetic, UR5. youbot: it mixes units."
    assert f"| std |  | ✗ | ✗ | ✓ | {sentence} |" in page


def test_the_results_of_the_readme_are_between_its_marks(grouped):
    before = "A.\n\n<!-- results -->\n"
    after = "<!-- /results -->\n\nB.\n"
    rows = tally(grouped)

    text = report_page.readme_with_results(f"{before}earlier\n{after}", grouped, rows)

    assert text.startswith(before) and text.endswith(after) and "earlier" not in text
    assert "all 1 claims that need no recording hold" in text
    assert "| computations without a recording | 1 | 0 | 0 | 0 |" in text
    with pytest.raises(ContractError, match="put them back"):
        report_page.readme_with_results(before, grouped, rows)


def test_a_trial_run_prints_no_verdict():
    page = report_page.trial_page(a_run("youbot", 0.75, scale="smoke"), DRAWN)
    assert page.startswith("# Trial run of dataset youbot on the scale smoke")
    assert "figures/own.png" in page and "Published" not in page
    assert not {"✓", "✗", "fails"} & {*re.split(r"\W+", page), *page}


@pytest.mark.parametrize(("greatest", "beyond"), [(15.2, True), (1.5, False)])
def test_speeds_beyond_the_limits_are_stated(greatest, beyond):
    numbers = {"true_moving_steps_beyond_a_speed_limit_share": 0.476}
    for joint in "abc":
        numbers[f"true_{joint}_greatest_speed_rad_per_s"] = greatest
        numbers[f"true_{joint}_speed_limit_rad_per_s"] = 1.57
        numbers[f"true_{joint}_fast_steps_backwards_share"] = 0.231

    text = speeds(replace(RUNS[0], metrics={"recordings": numbers}))

    assert ("a reaches 15.2 rad/s (limit 1.57), 47.6% of" in text) == beyond
    assert (text == "") != beyond and speeds(RUNS[0]) == ""


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

    text = open_choices.readings([run])

    assert "| small | lab | **✓** | ✗ |" in text
    assert (
        "- lab, QR: 1 claims lack numbers (no noise)." in text and "| gap |" not in text
    )
    assert open_choices.readings([RUNS[0]]) == say("default")


def test_three_estimators_are_side_by_side_and_an_unbounded_one_has_no_number(grouped):
    text = published_and_ours(RUNS[0], grouped)
    assert "| σ̂_B | 0.25 | 0.2877 | 0.227 [0.22, 0.235] | – |" in text
    assert "| û | – | 18 | unbounded | – |" in text
    assert "| error | 0.25 | no | 0.2 |" in text and "(no covariance)" not in text

    beyond = {"fit_wishart": FIT | {"sigma_b_limit_of_the_covariance": 0.25}}
    beyond["fit_wishart"]["sigma_b_likelihood"] = 1.02
    run = replace(RUNS[0], metrics=RUNS[0].metrics | beyond)
    text = published_and_ours(run, grouped)
    assert "αu = " not in text
    assert "| 0.2877 (no covariance) | 0.227 [0.22, 0.235] | 1.02 (no mean) |" in text


def test_sigma_b_over_the_bound_and_the_weight_is_a_table_of_its_erratum(grouped):
    floors = {"floor": [0.01, 0.5] * 2, "ratio": [1e-3, 1e-3, 2e-3, 2e-3]}
    floors["sigma_b"] = [11.978, 0.22633, 11.06, 0.195]
    floors = pd.concat([pd.DataFrame(floors).assign(model=m) for m in ("first", "b")])
    fitted = {"sigma_b_about_the_sample_mean": 0.4085}
    fitted |= {"fitted_mean_of_b_11": 1.433, "fitted_mean_of_b_22": 1.0166}
    tables = RUNS[0].tables | {"sigma_b_floors": floors}
    run = replace(RUNS[0], metrics={"fit_wishart": FIT | fitted}, tables=tables)

    text = open_choices.errata_details(run, grouped)["weights-not-given"]

    assert "| weight α₂/α₁ (rad) | ε = 0.5 | ε = 0.01 |" in text
    assert "| 0.001 | 0.226 | 12 |\n| 0.002 | 0.195 | 11.1 |" in text
    assert "is diag(1.43, 1.02), and" in text and "σ̂_B is 0.41." in text


def test_numbers_that_were_inputs_and_other_causes_of_the_arm_are_named():
    claims = parse_claims([SIGMA | {"id": "correlation-omega"}])
    first = replace(a_run("youbot", 0.1, 0.2, 0.3), cause="sway")
    causes = [first, replace(first, dataset="other", cause="timing")]
    causes.append(replace(first, dataset="arm", cause="", synthetic=False))

    text = published_and_ours(first, groups(*causes, claims=claims))

    columns = "youbot (sway) | other (timing) | arm (real)"
    assert f"| number | published | was it an input? | {columns} |" in text
    assert "| σ̂ | 0.25 | yes: path and size" in text
    assert text.endswith("| 0.2877 | 0.288 | 0.288 |")


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ({"u_moments_unbounded": 1}, "By moments only the noise level L is determined"),
        ({"u_likelihood_unbounded": 0}, "By likelihood u and α are determined too"),
    ],
)
def test_the_level_of_the_published_pair_is_beside_the_fitted_level(ends, words):
    claims = parse_claims(
        [
            SIGMA | {"id": name, "published": n}
            for name, n in (("u", 18.0), ("alpha", 0.1))
        ],
    )
    fitted = {"noise_level_moments": 3.36} | LEVEL | ends
    metrics = RUNS[0].metrics | {"fit_gaussian": fitted}
    run = replace(RUNS[0], joints=["a", "b", "c"], metrics=metrics)

    text = published_and_ours(run, groups(run, claims=claims))

    assert "| L = α√(u² − ⟨‖J⁻¹‖²⟩) | 1.066 (of û and α̂) | – | 3.36 | – |" in text
    assert words in text
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
    models = {"wishart": "wishart", "additive": "additive"}
    tables = {"evidence": evidence_table(rows)}
    run = replace(RUNS[1], joints=["a", "b"], models=models, tables=tables)

    (text,) = widths(run)

    assert "2.25 times as wide as the recordings in a and 0.5 times in b; its" in text
    assert text.endswith("above the error of no noise, 1, in a.")


def test_counts_are_totals_and_no_mean_share_or_row_number_is_among_them():
    lost = [("camera", "cut_rows", "count", 3.0), ("camera", "gaps", "count", 0.0)]
    quality = pd.DataFrame(lost, columns=["instrument", "quantity", "unit", "total"])
    counts = {"particle_steps_outside_the_domain": 19194, "mean_sample_size": 7}
    recorded = {"camera_cut_rows": 3, "mean_camera_missing_share": 0.007}
    metrics = {"recordings": recorded, "filter_wishart": counts}
    tables = {"recording_quality": quality}

    picture = {"takes": {"title": "Every take", "caption": "Thin: takes that stay."}}
    page = recordings_page(replace(RUNS[1], metrics=metrics, tables=tables), picture)

    assert "![Every take](figures/takes.png)\nThin: takes that stay." in page
    assert "takes.png" not in recordings_page(RUNS[1], {})
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
                {"model": model, "score": score, "mean": SCORES[score] + by} | ends,
            )

    tables = {"filter_against_none": pd.DataFrame(rows)}
    return Run("lab", "paper", True, ["a", "b"], PLANE, {}, {}, tables)


LOWER = {"memory": (-0.5, 0.5), "wishart": (-0.5, -1.0)}
LOWER |= {"additive_closed": (0.05, -0.75)}
HIGHER = {"wishart_closed": (0.0, 0.5), "additive": (0.5, -1.0)}


@pytest.mark.parametrize(
    ("differences", "start", "end"),
    [
        (
            LOWER,
            "On lab no particle filter has a higher log score than the mean and",
            "has a higher log score than the training mean.",
        ),
        (
            HIGHER,
            "On lab these particle filters have a higher log score",
            ": wishart, closed loop.",
        ),
    ],
)
def test_filters_with_a_higher_log_score_are_named(differences, start, end):
    text = filter_verdict(filtered(**differences))
    assert text.startswith(start) and text.endswith(end)


def test_each_filter_has_a_row_and_a_smaller_rms_error_is_named():
    run = filtered(**LOWER)
    assert " in every joint: wishart, open loop. The linear" in filter_verdict(run)

    row = "| wishart, open loop | -0.49 | -0.49 | 0.7 | – | 4 (-1 [-1.1, -0.9]) |"
    assert row in filters(run).splitlines()
    assert filters(RUNS[0]) == ""


def test_the_result_states_differences_of_predictors_and_filters():
    run = filtered(**LOWER)
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


def test_the_error_without_a_random_matrix_is_beside_the_errors_of_the_study():
    place = {"estimator": "none"}
    rows = [
        evidence_row("mean_error_of_variances", error, configuration=cables, **place)
        for cables, error in (("20", 0.0784), ("5", 0.08), ("3", 0.0832))
    ]
    run = replace(RUNS[1], tables={"evidence": evidence_table(rows)})

    (text,) = without_random_matrix(run)

    assert "the mean error is 8.3 % with 3 and 7.8 % with 20 cables" in text
    assert without_random_matrix(RUNS[1]) == []


def test_a_claim_in_per_cent_has_its_value_and_interval_in_per_cent():
    claim = STUDY | {"id": "percent", "statement": "The greatest error is 25 %."}
    rows = [evidence_row("greatest_error_of_variances", 0.0575, 0.0552, 0.08)]
    run = replace(RUNS[1], tables={"evidence": evidence_table(rows)})
    independent = groups(run, claims=parse_claims([claim]))[0]
    (verdict,) = independent.verdicts["no recording"]

    assert case_count(verdict) == "5.75 %, interval 5.52 to 8 %"


def test_a_claim_that_a_single_run_does_not_decide_has_its_cases_and_power_on_the_page():
    claims = parse_claims([VARIES])
    keys = {"model": "recorded"}
    rows = []
    for joint, low, power in (
        ("a", 0.3, 0.9),
        ("b", -0.5, 0.42),
        ("c", float("nan"), 0.0),
    ):
        keys["joint"] = joint
        rows.append(evidence_row("std_variation", 0.4, **keys))
        rows.append(evidence_row("std_variation_limits", 0.25, 0.1, **keys))
        rows.append(evidence_row("ln_std_by_speed", 0.5, low, 1 - low, **keys))
        rows.append(evidence_row("ln_std_by_speed_power", power, **keys))
    tables = {"evidence": evidence_table(rows)}
    run = Run("logs", "paper", False, ["a", "b", "c"], [], {}, {}, tables)

    grouped = groups(run, claims=claims)
    page = datasets_page(grouped, [])
    (line,) = report_page.claim_lines(grouped)[""]

    assert line[1] == "logs no verdict: 1 of 3 hold, power of the others 0–0.42"
    assert "| no verdict: 1 of 3 hold, power of the others 0–0.42 |" in page
    assert "`logs` is a single run: varies is tested by the noise" in page
    assert "0.5 [0.3, 0.7] in a (holds); 0.5 [-0.5, 1.5] in b (power" in page
    assert "undetermined in c (too few blocks)." in page
