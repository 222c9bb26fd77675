"""The model card recommends a model by the rule that it states, with predictions and limits."""

import re
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside

from pipeline.evidence.table import evidence_row, evidence_table
from pipeline.models.joint_error.choice import left_out, pooled, pooled_interval
from pipeline.statistics.takes import jackknife_difference
from pipeline.verdicts.deviations import deviations, losses
from pipeline.verdicts.model_card import answer, model_card
from pipeline.verdicts.run import Run
from pipeline.verdicts.scores import choice

BASELINES = {"none": 10.0, "memory": 11.0, "additive": 9.0, "gaussian": 10.5}
PARAMETER = {
    "s": 0.5,
    "s_standard_error": 0.0125,
    "s_interval_low": 0.48,
    "s_interval_high": 0.53,
}
cases = cases_beside(__file__)
MOTIONS = ["motion", "takes", "steps", "moving"]
RANGE = ["quantity", "name", "unit", "least", "greatest"]
LAWS = {"joint_step": 8.0, "joint_error": 9.0}  # score of a joint and horizon
HORIZONS = ("one sample", "0.1 s", "0.5 s")


def moved(predicted: float = 1.1e-4, motions: int = 3, gain: float = 1.0) -> dict:
    """Return tables of held-out motions of the joints a and b, of which b hardly moved. The law
    with memory predicts the σ ``predicted`` where 1e-4 is measured and has the score of the white
    steps plus ``gain`` and a small part that differs by motion; white steps predict 1.2e-4.
    """
    names = [str(k) for k in range(1, motions + 1)]
    rows = []
    for (model, motion), (horizon, joint) in product(
        product(LAWS, names),
        product(HORIZONS, "ab"),
    ):
        memory = model == "joint_error"
        own = {
            "model": model,
            "motion": motion,
            "block": 1,
            "joint": joint,
            "horizon": horizon,
        }
        own |= {"samples": "commanded", "count": 100, "measured_rad": 1e-4}
        own |= {"score": 8.0 + (gain + 0.1 * int(motion) if memory else 0.0)}
        own |= {"predicted_rad": predicted if memory else 1.2e-4, "one_sigma": 0.7}
        rows += [own | {"two_sigma": 0.95, "autocorrelation": 0.25 if memory else 0.6}]
        rows += [rows[-1] | {"samples": "at rest", "score": 11.0}]
        rows += [rows[-2] | {"samples": "settled", "count": 80, "measured_rad": 5e-5}]
    known = []
    for model, j in product(LAWS, "ab"):
        numbers = (model, j, 2e-6, 8e-5, 0.05, 0.01, 4.5, 1.0, True)
        known.append((*numbers, -2e-3, 5e-4, 3, 6e-5, 0.02, 9e-5, 0.06))
    columns = (
        "model joint innovation_at_rest_rad innovation_at_greatest_speed_rad decay_s"
    )
    columns += " drift_share degrees greatest_speed has_mean lag_s lag_std_s logs"
    for end in ("least", "greatest"):
        columns += f" {end}:innovation_at_greatest_speed_rad {end}:decay_s"
    seen = [("pose", "a", "rad", -1.25, 2.5), ("joint speed", "a", "rad/s", -1.0, 0.5)]
    seen.append(("joint speed", "b", "rad/s", 0.0, 0.001))
    matrix = [
        ("wishart", "1", np.nan, "the Jacobian is singular at 3 measured pose(s)"),
    ]
    return {
        "joint_scores": pd.DataFrame(rows),
        "joint_parameters": pd.DataFrame(known, columns=columns.split()),
        "motions": pd.DataFrame([(k, 4, 300, "a") for k in names], columns=MOTIONS),
        "motion_ranges": pd.DataFrame(seen, columns=RANGE),
        "unused_recordings": pd.DataFrame(
            {"recording": ["run_9"], "reason": ["disturbed"]},
        ),
        "other_motions": pd.DataFrame(
            matrix,
            columns=["model", "motion", "score", "reason"],
        ),
    }


def predicted(half: float = 0.1, **matrix: float) -> Run:
    """Return a run of one joint with the log scores ``matrix`` of models and BASELINES, with
    intervals of ± ``half``.
    """
    means = BASELINES | matrix
    rows = []
    for model, mean in means.items():
        ends = {
            "difference": mean - 10,
            "low": mean - 10 - half,
            "high": mean - 10 + half,
        }
        for score, value in (("log_score", mean), ("coverage_of_one_sigma_a", 0.7)):
            rows.append(
                {"steps": "all", "model": model, "score": score, "mean": value} | ends,
            )
    pairs = [
        {
            "steps": "all",
            "model": model,
            "rival": rival,
            "low": means[model] - means[rival] - half,
        }
        for model, rival in permutations(means, 2)
    ]
    seen = [("pose", "a", "rad", -1.25, 2.5), ("joint speed", "a", "rad/s", 0.0, 1.0)]
    takes = [("t1", "training", False, ""), ("t2", "training", True, "too long a gap")]
    tables = {
        "predictions": pd.DataFrame(rows),
        "prediction_pairs": pd.DataFrame(pairs),
        "ranges": pd.DataFrame(seen, columns=RANGE),
        "takes": pd.DataFrame(takes, columns=["take", "part", "left_out", "reason"]),
    }
    models = {"additive": "additive"} | dict.fromkeys(matrix, "wishart")
    metrics = {f"fit_{name}": dict(PARAMETER) for name in models}
    return Run("lab", "paper", True, ["a"], ["x"], models, metrics, tables)


def logged(**changes) -> Run:
    return Run("bench", "paper", False, ["a", "b"], ["x"], {}, {}, moved(**changes))


def test_the_card_opens_with_the_law_its_predictions_and_what_was_not_used():
    page = model_card(logged(), [])
    first = page[: page.index("## Why")]
    assert (
        "**Model for another motion: joint error with memory** (`joint_error`)" in first
    )
    assert "highest mean log score of 2 sound laws" in first
    assert "nats a sample above joint_step." in first

    row = "| all commanded samples | 0.5 s | 100 % | 1.10 [1.10, 1.10]; joints 1.10 to"
    assert row in first and "jump of the commanded speed | 0.1 s | 80 % | 2.20" in first
    assert "| a | 1.1 [1.1, 1.1] | 1.1 [1.1, 1.1] |" in first
    assert "| 0.25 |" in first and "12 runs of 3 motion(s)" in first
    assert (
        "Not used: run_9 (disturbed)." in first
        and "moved at less than a tenth of the greatest speed: a." not in first
    )

    numbers = "| a | 2 | 80 [60, 90] | (0.05 [0.02, 0.06]) | 0.01 | 4.5 | -2 | 0.5 |"
    assert numbers in first and "The lags are those of 3 logs." in first
    # then the evidence, rest apart
    assert (
        "- Wishart matrix model: no score on motion 1: the Jacobian is singular" in page
    )
    assert "| a | one sample | 110 | 100 | 0.70 | 0.95 | 9.20 |" in page
    assert "| 1 | 4 | 300 | a |" in page and "Joints at rest" in page

    # a joint is never called both still and moving
    run = logged()
    ranges = run.tables["motion_ranges"]
    for moving, words in (("a", "never commanded to move: b."), ("a, b", "speed: b.")):
        run.tables["motions"]["moving"] = moving
        page = model_card(run, [])
        assert words in page
        assert page.count("never commanded") + page.count("than a tenth of") == 1
    ranges.loc[ranges["name"] == "b", "greatest"] = 0.11
    assert "than a tenth of" not in model_card(run, [])
    scores = run.tables["joint_scores"]
    assert "at rest** is" not in answer(run)
    scores.loc[scores["samples"] == "at rest", "two_sigma"] = 0.7
    assert (
        "rest** is unusable, 6 fault(s): 0.7 of the errors of a at one sample are"
        in answer(run)
    )


@pytest.mark.parametrize(
    ("predicted", "named"),
    [(1.35e-4, 0), (1.45e-4, 6), (0.7e-4, 6)],
)
def test_the_card_names_every_predicted_standard_deviation_that_is_not_confirmed(
    predicted,
    named,
):
    text = answer(logged(predicted=predicted))
    assert text.count(" !") == named
    assert f"| a | {predicted / 1e-4:.3g} [" in text
    assert "is not within 0.714 to 1.4" in text

    run = logged(predicted=predicted)
    run.tables["joint_scores"]["motion"] = (
        "quarter " + run.tables["joint_scores"]["motion"]
    )
    assert (
        "- **σ on another motion** is unknown: one motion was recorded (req"
        in answer(run)
    )


@cases("named laws")
def test_the_sound_law_with_the_highest_mean_score_is_named(changes, law):
    assert f"(`{law}`)" in answer(logged(**changes)).splitlines()[0]


@pytest.mark.parametrize("motions", [1, 2, 3])
def test_a_card_has_no_number_that_is_not_one(motions):
    run = logged(motions=motions)
    run.tables["joint_scores"]["autocorrelation"] = np.nan  # of single samples

    page = model_card(run, [])

    assert not re.search(r"\b(nan|inf)\b", page)
    # control: with several motions the intervals stand in the card
    assert ("1.1 [1.1, 1.1]" in page) == (motions > 2)
    assert ("too few parts for an interval" in page) == (motions < 3)


def test_joint_logs_of_an_arm_of_unknown_geometry_have_their_law():
    run = logged()
    card = model_card(replace(run, joints=[], task=[]), [])
    assert "**Model for another motion: joint error with memory**" in card
    # control: forces alone
    forces = Run("towing", "paper", False, [], [], {}, {}, {})
    assert "**No model is recommended**" in model_card(forces, [])
    with_forces = model_card(run, [forces])
    assert "towing" not in with_forces


def test_a_card_without_jumps_of_the_speed_repeats_no_rows():
    run = logged()
    scores = run.tables["joint_scores"]
    run.tables["joint_scores"] = scores[scores["samples"] != "settled"]
    page = model_card(run, [])
    assert "| those not within 0.6 s of a jump" not in page

    settled, mean = page.split("| joint error with memory | ")[1].split(" | ")[3:5]
    assert settled == mean


def test_intervals_of_few_motions_are_of_the_possible_values():
    scores = moved()["joint_scores"].query(
        "model == 'joint_error' and samples == 'commanded'",
    )
    numbers = scores["motion"].astype(float)
    wide = scores.assign(
        predicted_rad=3e-5 * numbers**2,
        two_sigma=1.06 - 0.06 * numbers,
    )
    wide["two_sigma"] = wide["two_sigma"].clip(upper=1.0)
    ratio, share = (
        pooled_interval(left_out(wide), name) for name in ("ratio", "two_sigma")
    )
    assert (
        0 < ratio.low < ratio.difference < ratio.high
        and 0 < share.low < share.high == 1
    )

    # control: the interval of the plain ratio would contain a negative one
    each = [
        wide[wide["motion"] != n].pipe(pooled, ["model"])["ratio"].iloc[0]
        for n in "123"
    ]
    assert jackknife_difference(np.array([ratio.difference, *each])).low < 0


def test_no_law_is_an_answer_with_its_reason():
    run = logged(predicted=2.1e-4)
    scores = run.tables["joint_scores"]
    scores.loc[scores["model"] == "joint_step", "two_sigma"] = 0.7

    text = answer(run)

    assert text.startswith("**No model for another motion**: ")
    assert "0.7 of the errors of a at one sample are within 2σ (required: 0.8)" in text
    assert "predicted σ of a at one sample is 2.1 times the measured" in text


@pytest.mark.parametrize(("score", "half"), [(10.7, 0.1), (11.05, 0.1)])
def test_a_matrix_model_is_recommended_for_this_motion_by_its_intervals_alone(
    score,
    half,
):
    text = choice(predicted(half, wishart=score))  # below, or above within the interval
    assert text.startswith(
        "On lab **no matrix model** has a log score above every baseline:",
    )
    assert " Wishart matrix model not above autoregressive baseline." in text
    assert choice(predicted(wishart=12.0, other=11.5)).startswith(
        "The log score of the **Wishart",
    )


def test_the_card_holds_parameters_ranges_takes_and_other_datasets():
    run = predicted(wishart=12.0)
    other = predicted(wishart=10.7)
    page = model_card(run, [other])
    assert "| wishart | s | 0.5 | 0.0125 | [0.48, 0.53] |" in page
    assert (
        "| pose | a | rad | -1.25 | 2.5 |" in page and "| all | a | 0.7 | 0.7 |" in page
    )
    assert (
        "Takes kept: 1 training; left out: 1." in page
        and "| t2 | too long a gap |" in page
    )
    assert page.count("- lab: ") == 1

    run.tables["evidence"] = evidence_table(
        [evidence_row("takes", 4, model="recorded")],
    )
    assert "| wishart | s | 0.5 | 0.0125 | – |" in model_card(run, [])


@cases("no numbers")
def test_a_parameter_that_the_recordings_cannot_tell_has_no_number(fitted, absent):
    run = predicted(wishart=12.0)
    run.metrics["fit_additive"] |= fitted
    run.tables["ranges"].loc[2] = ("joint speed", "b", "rad/s", 0.0, 0.001)

    page = model_card(run, [])

    assert f"no number for {absent}" in page
    assert not any(f"| additive | {name} |" in page for name in fitted)


def scores_of_the_card(ratio_on_third_motion: float, lost: float) -> pd.DataFrame:
    """Return scores of ``moved`` with another ratio of the law's σ on the third motion, and a
    constant that has ``lost`` nats more by joint at one sample, and 1 nat less elsewhere.
    """
    scores = moved(predicted=1e-4, motions=8)["joint_scores"]
    law = scores["model"] == "joint_error"
    third = law & (scores["motion"] == "3") & (scores["horizon"] == "0.5 s")
    scores.loc[third, "predicted_rad"] *= ratio_on_third_motion
    constant = scores[law].assign(model="joint_constant")
    nearest = constant["horizon"] == "one sample"
    constant["score"] += np.where(nearest, lost, -1.0)
    return pd.concat([scores, constant])


def run_of_scores(scores: pd.DataFrame) -> Run:
    """Return a run with the tables of ``moved`` and the ``scores``."""
    tables = moved() | {"joint_scores": scores}
    return Run("arm", "paper", False, ["a", "b"], [], {}, {}, tables)


def test_the_card_names_what_is_beyond_its_limits_and_the_motion_that_causes_it():
    scores = scores_of_the_card(4.0, 0.4)
    rows = deviations(scores, "joint_error")
    assert [(row.joint, row.horizon) for row in rows] == [
        ("a", "0.5 s"),
        ("b", "0.5 s"),
    ]
    for row in rows:
        assert row.ratio == pytest.approx(np.sqrt((7 + 16) / 8))
        assert row.cause.startswith("motion 3, which")
        assert row.cause.endswith("without it 1.00 and 0.70")
    (sentence,) = losses(scores, "joint_error")
    assert "0.80 nats above that of the law, 0.40 of them in a." in sentence
    assert "This difference is -2.00 at 0.1 s and -2.00 at 0.5 s;" in sentence

    text = answer(run_of_scores(scores))
    assert sentence in text
    for row in rows:
        assert f"| {row.joint} | {row.horizon} | {row.ratio:.4g} |" in text
    # control: within the limits there is no such paragraph
    scores = scores_of_the_card(1.4, 0.2)
    assert not deviations(scores, "joint_error")
    assert not losses(scores, "joint_error")
    text = answer(run_of_scores(scores))
    assert "Beyond the limits" not in text


def test_tails_and_several_motions_are_causes_of_a_deviation_too():
    scores = moved(predicted=0.6e-4, motions=8)["joint_scores"]
    causes = {row.cause for row in deviations(scores, "joint_error")}
    assert causes == {
        "few large errors make the measured σ: 0.70 of the errors are within ±1σ, 0.95 within ±2σ",
    }
    scores = moved(predicted=1.8e-4, motions=8)["joint_scores"]
    causes = {row.cause for row in deviations(scores, "joint_error")}
    assert causes == {"σ is too large in more than one held-out part"}
    # of a joint with few samples no figure is certain enough
    assert not deviations(scores.assign(count=2), "joint_error")
