"""The model card names a matrix model only where it beats every plain baseline by its interval."""

from __future__ import annotations

from itertools import permutations

import pandas as pd
import pytest

from pipeline.verdicts.model_card import UNKNOWN, choice, model_card
from pipeline.verdicts.run import Run

PLAIN = {"none": 10.0, "memory": 11.0, "additive": 9.0, "scaled_full": 10.5}
FIT = {"s": 0.5, "s_standard_error": 0.0125, "s_interval_low": 0.48, "s_interval_high": 0.53}


def a_run(half: float = 0.1, **matrix: float) -> Run:
    """A run of one joint whose models have log scores ``matrix``, and baselines those of PLAIN;
    ``half`` is that of the intervals of every difference.
    """
    means, rows = PLAIN | matrix, []
    for model, mean in means.items():
        ends = {"difference": mean - 10, "low": mean - 10 - half, "high": mean - 10 + half}
        for score, value in (("log_score", mean), ("coverage_of_one_sigma_a", 0.7)):
            rows.append({"steps": "all", "model": model, "score": score, "mean": value} | ends)
    pairs = [
        {"steps": "all", "model": model, "rival": rival, "low": means[model] - means[rival] - half}
        for model, rival in permutations(means, 2)
    ]
    takes = [("t1", "training", False, ""), ("t2", "training", True, "too long a gap")]
    tables = {
        "predictions": pd.DataFrame(rows),
        "prediction_pairs": pd.DataFrame(pairs),
        "ranges": pd.DataFrame(
            [("pose", "a", "rad", -1.25, 2.5)],
            columns=["quantity", "name", "unit", "least", "greatest"],
        ),
        "takes": pd.DataFrame(takes, columns=["take", "part", "left_out", "reason"]),
    }
    models = {"additive": "additive"} | dict.fromkeys(matrix, "wishart")
    metrics = {f"fit_{name}": FIT for name in models}
    return Run("lab", "paper", True, ["a"], ["x"], models, metrics, tables)


def test_a_matrix_model_that_beats_every_plain_one_is_named():
    said = choice(a_run(wishart=12.0, other=11.5))
    assert said.startswith("**wishart**, a matrix model, beats every plain baseline.")
    assert "For another motion of this arm, of which no takes are at hand, take wishart." in said


@pytest.mark.parametrize(
    ("score", "half", "unbeaten"),
    [
        (10.7, 0.1, "memory"),
        (11.05, 0.1, "memory"),  # better, and within the interval
        (9.5, 0.1, "none, memory and scaled_full"),
        (12.0, 5.0, "none, memory, additive and scaled_full"),
    ],
)
def test_else_none_is_the_first_word_and_what_is_not_beaten_is_named(score, half, unbeaten):
    page = model_card(a_run(half, wishart=score), [])
    first = page.splitlines()[2]
    assert first.startswith(f"**None of the matrix models.** wishart does not beat {unbeaten}.")


def test_what_is_not_told_apart_from_the_best_is_said_and_how_to_get_it():
    said = choice(a_run(wishart=10.45))
    assert "Of all, memory predicts the steps of this motion best. " in said
    assert "take scaled_full (not told apart from wishart)." in said
    assert "Name it in `models` of `params.yaml`" in said


def test_the_card_holds_parameters_ranges_and_what_was_left_out():
    page = model_card(a_run(wishart=12.0), [])
    assert "| wishart | s | 0.5 | 0.0125 | [0.48, 0.53] |" in page
    assert "| pose | a | rad | -1.25 | 2.5 |" in page
    assert "Takes kept: 1 training; left out: 1." in page and "| t2 | too long a gap |" in page
    assert "| all | a | 0.7 | 0.7 |" in page


def test_other_datasets_that_are_scored_have_their_own_choice():
    other, unscored = a_run(wishart=10.7), a_run(wishart=12.0)
    del unscored.tables["predictions"]
    page = model_card(a_run(wishart=12.0), [other, unscored])
    assert page.count("- lab: **None of the matrix models.** wishart does not beat memory.") == 1
    assert page.count("- lab: ") == 1


def test_a_baseline_without_a_score_is_said_and_beats_nothing():
    run = a_run(wishart=10.7)
    scores = run.tables["predictions"]
    scores.loc[(scores["model"] == "memory") & (scores["score"] == "log_score"), "mean"] = float(
        "nan"
    )
    said = choice(run)
    assert said.startswith("**wishart**, a matrix model, beats every plain baseline.")
    assert "memory has no score." in said


def test_without_scores_no_model_is_named():
    run = a_run(wishart=12.0)
    for name in ("predictions", "prediction_pairs"):
        del run.tables[name]
    page = model_card(run, [])
    assert UNKNOWN in page and "## Why" not in page and "matrix model" not in page
