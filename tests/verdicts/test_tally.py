"""Every dataset counts once: shared takes and causes of the noise are joined, and each failure is
named.
"""

from itertools import combinations_with_replacement

import pandas as pd
import pytest
from case_tables import cases_beside

from pipeline.core.columns import PLANE
from pipeline.evidence.table import evidence_row, evidence_table
from pipeline.verdicts.claims import parse_claims, read_claims
from pipeline.verdicts.decision import (
    SYNTHETIC_WITH_SPEED_LAW,
    WITH_SPEED_LAW,
    decide_each,
)
from pipeline.verdicts.encoders import encoder_noise
from pipeline.verdicts.finding import finding
from pipeline.verdicts.run import Run
from pipeline.verdicts.tally import (
    COUNTED,
    DEPENDS,
    FAILS,
    HOLDS,
    SPEED_LAW,
    Group,
    groups_of,
    joined_text,
    joined_verdicts,
    tally,
)

cases = cases_beside(__file__)
STATED = {key: f"the {key}" for key in ("where", "statement", "quantity", "reason")}
VALUE = {"quantity": "std", "joint": "{joint}"}
BELOW = STATED | {"rule": "below", "limit": 0.5, "each": {"joint": "every"}}
BELOW |= {"value": VALUE}
STUDY = STATED | {"rule": "below", "limit": 0.5, "recording": "none"}
STUDY |= {"value": {"quantity": "greatest_error_of_variances"}}
CLAIMS = parse_claims(
    [
        BELOW | {"id": "of-method", "about": "method", "why": {"c": "it mixes units"}},
        BELOW | {"id": "of-robots", "about": "robots"},
        STUDY | {"id": "study", "about": "method"},
    ],
)
ARM = ("a", "b")
OTHER = ("a", "b", "c")


def a_run(
    dataset: str,
    std: float,
    *,
    joints=ARM,
    cause="",
    files=(),
    synthetic=None,
) -> Run:
    rows = [evidence_row("std", std, joint=joint) for joint in joints]
    rows.append(evidence_row("greatest_error_of_variances", 0.2))
    raw = pd.DataFrame({"place": ["LICENSE", *files], "sha256": ["licence", *files]})
    tables = {"evidence": evidence_table(rows), "raw_files": raw}
    kind = cause != "" if synthetic is None else synthetic
    return Run(dataset, "paper", kind, [*joints], PLANE, {}, {}, tables, cause=cause)


def groups(*runs: Run) -> list[Group]:
    return groups_of(runs, decide_each(CLAIMS, runs, []))


def words(group: Group) -> dict[str, str]:
    return {joined.claim.id: joined.word for joined in joined_verdicts(group)}


def texts(group: Group) -> dict[str, str]:
    verdicts = joined_verdicts(group)
    return {joined.claim.id: joined_text(group, joined) for joined in verdicts}


def test_datasets_that_share_takes_are_one_group_but_not_those_that_share_a_licence():
    _, sharing, alone = groups(
        a_run("a", 0.1, files=["1", "2"]),
        a_run("b", 0.1, files=["3"]),
        a_run("c", 0.7, files=["2"], joints=OTHER),
    )

    assert [run.dataset for run in sharing.runs] == ["a", "c"]
    assert [run.dataset for run in alone.runs] == ["b"]
    assert words(sharing)["of-robots"] == FAILS
    assert words(alone)["of-robots"] == HOLDS
    assert texts(sharing)["of-robots"] == "✗ fails in c (0 of 3); holds in a"
    assert texts(sharing)["of-method"].endswith("; reason: it mixes units (c)")
    assert texts(alone)["of-robots"] == "✓ holds"


@cases("causes")
def test_a_claim_about_robots_is_stated_over_the_causes_of_one_arm(stds, word, text):
    runs = []
    for cause, std in zip(("sway", "timing", "poses"), stds, strict=True):
        runs.append(a_run(f"lab_{cause}", std, cause=cause, files=[cause]))

    independent, group = groups(*runs)
    rows = tally([independent, group])

    assert words(group)["of-robots"] == word and texts(group)["of-robots"] == text
    of_recordings = dict.fromkeys(("of-method", "of-robots"), "no evidence")
    assert words(independent) == of_recordings | {"study": HOLDS}
    assert [row.decides for row in rows] == [True, True, False]
    counts = {counted: len(rows[2].claims[counted]) for counted in COUNTED}
    assert counts == dict.fromkeys(COUNTED, 0) | {word: 1}


@pytest.mark.parametrize(
    ("cause", "verdict", "text"),
    [
        ("", WITH_SPEED_LAW, "✓ (speed law too) holds, as does the speed law"),
        ("sway", SYNTHETIC_WITH_SPEED_LAW, "holds, as does the speed law"),
    ],
)
def test_what_a_law_of_the_speed_passes_too_is_counted_apart(cause, verdict, text):
    run = a_run("lab", 0.1, cause=cause)
    column, independent = decide_each(CLAIMS, [run], [])
    shared = [decision._replace(verdict=verdict) for decision in column.verdicts]
    decided = [column._replace(verdicts=shared), independent]

    group = groups_of([run], decided)[1]

    assert texts(group)["of-robots"] == text
    counts = {word: 0 for word in COUNTED}
    for row in tally([group]):
        for word in COUNTED:
            counts[word] += len(row.claims[word])
    assert counts == dict.fromkeys(COUNTED, 0) | {SPEED_LAW: 3}


def test_another_task_with_the_same_takes_is_no_cause():
    runs = [
        a_run("lab", 0.1, cause="sway", files=["1"]),
        a_run("lab_timing", 0.1, cause="timing", files=["2"]),
        a_run("lab_task", 0.7, cause="sway", files=["1"], joints=OTHER),
    ]

    _, group = groups(*runs)

    assert words(group)["of-method"] == FAILS
    expected = "✗ holds under 2 of 2 causes; fails in lab_task (0 of 3)"
    assert texts(group)["of-method"] == expected
    # a claim that depends on the cause still does
    runs[1] = a_run("lab_timing", 0.7, cause="timing", files=["2"])
    _, group = groups(*runs)
    assert words(group)["of-method"] == DEPENDS


def test_synthetic_datasets_of_another_arm_or_without_a_cause_are_not_joined():
    _, *separate = groups(
        a_run("lab", 0.1, cause="sway"),
        a_run("arm", 0.1, cause="timing", joints=OTHER),
        a_run("unnamed", 0.1, synthetic=True),
        a_run("real", 0.1),
    )
    assert [len(group.runs) for group in separate] == [1, 1, 1, 1]


def test_the_finding_takes_the_printed_estimator_from_the_arm_with_the_causes():
    fitted = {"sigma_b_moments": 0.2271, "sigma_b_least_over_floors": 0.2263}
    fitted |= {"sigma_b_greatest_over_floors": 11.978}
    user = a_run("user", 0.1)
    user.metrics["fit_wishart"] = dict.fromkeys(fitted, 0.0123)
    lab = a_run("lab", 0.1, cause="sway")
    lab.metrics["fit_wishart"] = fitted

    sentences = finding(groups(user, lab), [])

    (text,) = [text for text in sentences if "printed problem" in text]

    assert "returns 0.226 to 12 by a bound" in text and "gives 0.227." in text


def test_the_finding_compares_the_published_noise_with_the_encoders_of_a_real_arm():
    papers = [c for c in read_claims() if c.id in ("sigma-omega", "correlation-omega")]
    lab = a_run("lab", 0.1, joints=OTHER, cause="sway")
    logs = a_run("logs", 0.1, joints=[])
    pairs = [*combinations_with_replacement(OTHER, 2)]
    rows = pd.DataFrame(pairs, columns=["joint", "other"])
    rows["covariance"] = [1e-6, 0, 2e-7, 1e-6, 0, 4e-6]
    rows["correlation"] = [1, 0, 0.1, 1, 0, 1]
    logs.tables["step_noise"] = rows.assign(steps="all")
    grouped = groups_of([lab, logs], decide_each(papers, [lab, logs], []))

    (text,) = [text for text in finding(grouped, []) if "encoders" in text]

    stds = (
        "5.7 to 7.8 times the noise that the encoders of a real logs show (1 to 2 mrad"
    )
    assert stds in text
    noise = encoder_noise([lab, logs], OTHER)
    verdicts = grouped[1].verdicts["lab"]
    values = [noise.values(of.claim.id, of.cases) for of in verdicts]
    assert values == [[1e-6, 0, 2e-7, 1e-6, 0, 4e-6], [0, 0.1, 0]]
    assert encoder_noise([lab, logs], [*OTHER, "fourth"]) is None


def a_scored_run(dataset: str, wishart: float, speed: float) -> Run:
    """Return a real run whose Wishart model is ``wishart`` nats above constant noise."""
    run = a_run(dataset, 0.1)
    means = {"additive": 0.0, "wishart": wishart, "speed": speed}
    rows = [
        {"steps": "all", "model": model, "score": "log_score", "mean": mean}
        for model, mean in means.items()
    ]
    pair = {"steps": "all", "model": "wishart", "rival": "additive"}
    pair |= {"difference": wishart, "low": wishart - 1, "high": wishart + 1}

    run.tables["predictions"] = pd.DataFrame(rows)
    run.tables["prediction_pairs"] = pd.DataFrame([pair])
    run.models["wishart"] = "wishart"
    return run


@pytest.mark.parametrize(
    ("wishart", "words"),
    [
        (-27604.7, "neither matrix model predicts"),
        (0.5, "neither matrix model predicts"),
        (3.21, "only the Wishart matrix model predicts"),
    ],
)
def test_the_finding_states_real_robots_by_the_sign_of_the_interval(wishart, words):
    of_run = groups(a_scored_run("user", wishart, speed=5.0))

    sentences = finding(of_run, tally(of_run))

    (real,) = [text for text in sentences if "real arms" in text]
    assert words in real
    size = {-27604.7: "lower by 27,600 (user)", 3.21: "higher by 3.21 (user)"}
    assert size.get(wishart, "not significantly different on user") in real
    assert real.endswith("is above both on user.")
    assert "all 1 claims that need no recording hold" in sentences[0]
    assert not any("printed problem" in text for text in sentences)


def test_without_a_counted_run_there_is_one_group_of_the_claims_without_recording():
    (group,) = groups_of([], decide_each(CLAIMS, [], []))
    assert group.runs == ()
