"""The model card recommends a model by the rule that it states, with formula and limits."""

from itertools import permutations

import numpy as np
import pandas as pd
import pytest

from pipeline.verdicts.model_card import answer, model_card
from pipeline.verdicts.run import Run
from pipeline.verdicts.scores import choice

BASELINES = {"none": 10.0, "memory": 11.0, "additive": 9.0, "scaled_full": 10.5}
PARAMETER = {"s": 0.5, "s_standard_error": 0.0125, "s_interval_low": 0.48, "s_interval_high": 0.53}
LIMIT = "sigma_b_limit_of_the_covariance"
RANGE = ["quantity", "name", "unit", "least", "greatest"]
PARAMETERS = "model joint at_rest_rad share_of_step per_angle_rad degrees greatest_step_rad"
COLUMNS = {
    "other_motions": "model motion score reason",
    "motion_spread": "motion joint model predicted_rad measured_rad",
    "tails": "model joint kurtosis one_sigma two_sigma three_sigma",
    "plain_parameters": PARAMETERS,
    "untold": "model parameter joint found required",
    "motions": "motion takes steps moving",
    "motion_ranges": " ".join(RANGE),
}


def moved(predicted: float = 1.1e-4, motions: int = 2) -> dict[str, pd.DataFrame]:
    """Return tables of held-out motions of the joints a and b, of which b hardly moved."""
    names = [str(k) for k in range(1, motions + 1)]
    models = {"additive_all": 50.0, "scaled_t": 60.0}
    scores = [(model, k, score, "") for model, score in models.items() for k in (*names, "each")]
    scores.append(("wishart", "1", np.nan, "the Jacobian is singular at 3 measured pose(s)"))
    scores.append(("wishart", "each", np.nan, ""))
    tails = [(11.5, 0.85, 0.95, 0.991), (44.0, 0.9, 0.96, 0.985)]
    known = [(2e-6, 0.021, np.nan, 4.5, 8e-3), (3e-6, *3 * [np.nan], 1e-5)]
    rows = {
        "other_motions": scores,
        "motion_spread": [(k, j, m, predicted, 1e-4) for k in names for j in "ab" for m in models],
        "tails": [("scaled_t", j, *own) for j, own in zip("ab", tails, strict=True)],
        "plain_parameters": [("scaled_t", j, *own) for j, own in zip("ab", known, strict=True)],
        "untold": [("scaled_t", "gain", "b", "0 steps of at least 0.0008 rad", "20 steps")],
        "motions": [(k, 4, 300, "a") for k in names],
        "motion_ranges": [
            ("pose", "a", "rad", -1.25, 2.5),
            ("joint speed", "a", "rad/s", -1.0, 1.0),
            ("joint speed", "b", "rad/s", 0.0, 0.001),
        ],
    }
    return {name: pd.DataFrame(own, columns=COLUMNS[name].split()) for name, own in rows.items()}


def predicted(half: float = 0.1, **matrix: float) -> Run:
    """Return a run of one joint with the log scores ``matrix`` of models and BASELINES, with
    intervals of ± ``half``.
    """
    means, rows = BASELINES | matrix, []
    for model, mean in means.items():
        ends = {"difference": mean - 10, "low": mean - 10 - half, "high": mean - 10 + half}
        for score, value in (("log_score", mean), ("coverage_of_one_sigma_a", 0.7)):
            rows.append({"steps": "all", "model": model, "score": score, "mean": value} | ends)
    pairs = [
        {"steps": "all", "model": model, "rival": rival, "low": means[model] - means[rival] - half}
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
    metrics = {f"fit_{name}": dict(PARAMETER) for name in models} | {"motion": {}}
    return Run("lab", "paper", True, ["a"], ["x"], models, metrics, tables)


def logged(**changes) -> Run:
    return Run("bench", "paper", False, ["a", "b"], ["x"], {}, {}, moved(**changes))


def test_the_card_opens_with_the_model_its_formula_unknowns_and_tails():
    page = model_card(logged(), [])
    first = page[: page.index("## Why")]
    assert "**Model for another motion: speed-scaled, Student's t** (`scaled_t`)" in first
    assert "Δq_j + √(a_j² + b_j²·Δq_j²)·e_j" in first and "Fitted to 8 takes of 2 mot" in first
    assert "| a | 2 µrad | 2.1 % | 4.5 |" in first and "| b | 3 µrad | not known | – |" in first
    assert "No number for the gain of b (0 steps" in first and "stood still: b." in first
    assert "(kurtosis 11.5 to 44; 3 for normal noise)" in first and "At least 98.5 %" in first
    # then the evidence, the refused model with its reason
    assert "| speed-scaled, Student's t | 60 | 60 | 60 |" in page
    assert "- Wishart matrix model: no score on motion 1: the Jacobian is singular" in page
    assert "| 1 | b | 100 | 110 | 110 |" in page and "| 1 | 4 | 300 | a |" in page


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"motions": 1}, "the recordings have one motion"),
        ({"predicted": 4.2e-4}, "misses 100 % of the held-out standard deviations"),
        ({"predicted": 2e-5}, "misses 100 % of the held-out standard deviations"),
    ],
)
def test_no_model_is_an_answer_with_its_reason(changes, reason):
    text = answer(logged(**changes))
    assert text.startswith("**No model for another motion**: ") and reason in text
    assert answer(logged(predicted=3.8e-4)).startswith("**Model for another motion")


@pytest.mark.parametrize(("score", "half"), [(10.7, 0.1), (11.05, 0.1)])
def test_a_matrix_model_is_recommended_for_this_motion_by_its_intervals_alone(score, half):
    text = choice(predicted(half, wishart=score))  # below, or above within the interval
    assert text.startswith("On lab **no matrix model** has a log score above every baseline:")
    assert " Wishart matrix model not above autoregressive baseline." in text
    assert choice(predicted(wishart=12.0, other=11.5)).startswith("The log score of the **Wishart")


def test_the_card_holds_parameters_ranges_takes_and_other_datasets():
    run, other = predicted(wishart=12.0), predicted(wishart=10.7)
    page = model_card(run, [other])
    assert "| wishart | s | 0.5 | 0.0125 | [0.48, 0.53] |" in page
    assert "| pose | a | rad | -1.25 | 2.5 |" in page and "| all | a | 0.7 | 0.7 |" in page
    assert "Takes kept: 1 training; left out: 1." in page and "| t2 | too long a gap |" in page
    assert page.count("- lab: ") == 1
    run.metrics["motion"] = {"recorded_takes": 4}
    assert "| wishart | s | 0.5 | 0.0125 | – |" in model_card(run, [])


@pytest.mark.parametrize(
    ("fitted", "absent"),
    [
        ({"u": 9.0, "u_unbounded": 1, "u_standard_error": 1.0, "alpha": 0.1}, "alpha"),
        ({"sigma_b": 0.75, "sigma_b_standard_error": 0.1, LIMIT: 0.7071}, "sigma_b"),
        ({"std_share_of_the_step_b": 9.0}, "std_share_of_the_step_b"),
    ],
)
def test_a_parameter_that_the_recordings_cannot_tell_has_no_number(fitted, absent):
    run = predicted(wishart=12.0)
    run.metrics["fit_additive"] |= fitted
    run.tables["ranges"].loc[2] = ("joint speed", "b", "rad/s", 0.0, 0.001)
    page = model_card(run, [])
    assert f"no number for {absent}" in page
    assert not any(f"| additive | {name} |" in page for name in fitted)
