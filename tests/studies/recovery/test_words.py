"""The words on the controls are what the table of the controls says."""

from __future__ import annotations

import pandas as pd

from pipeline.studies.recovery.words import controls

CORRELATIONS = {"a": 0.06, "b": 0.01, "c": -0.05}


def rows(*entries: tuple) -> pd.DataFrame:
    columns = ["true", "fitted", "log_score", "difference", "low", "high", "undetermined"]
    return pd.DataFrame(entries, columns=columns).assign(
        **{f"std_correlation:{joint}": value for joint, value in CORRELATIONS.items()}
    )


def said(table: pd.DataFrame, matrix_models: list[str]) -> str:
    return "\n".join(controls(table, matrix_models))


def test_the_truths_own_fit_the_best_rival_and_the_refuted_claim_are_named():
    text = said(
        rows(
            ("additive", "additive", 10.94, -0.002, -0.003, -0.001, False),
            ("additive", "additive, consistent", 10.942, -0.0001, -0.001, 0.0005, False),
            ("additive", "gaussian", -40.0, -52.0, -53.0, -51.0, False),
            ("additive", "scaled", 10.9, -0.04, -0.05, -0.03, False),
        ),
        ["gaussian"],
    )
    assert "the best of the other models is scaled" in text and "No other beats it" in text
    assert "gaussian -52 [-53, -51] nats" in text and "+0.06, +0.01, -0.05" in text


def test_a_rival_that_beats_the_truth_is_said():
    text = said(
        rows(
            ("wishart", "wishart", 11.0, -0.5, -0.6, -0.4, False),
            ("wishart", "scaled", 12.0, 0.5, 0.4, 0.6, False),
        ),
        ["wishart"],
    )
    assert "Better than the true one's own fit: scaled." in text and "refuted" not in text


def test_the_papers_estimator_that_loses_on_its_own_model_is_said():
    text = said(
        rows(
            ("wishart", "wishart", 10.8, -0.54, -0.57, -0.51, False),
            ("wishart", "wishart, consistent", 11.36, 0.0, -0.001, 0.001, False),
            ("wishart", "additive", 7.3, -4.0, -4.1, -3.9, False),
        ),
        ["wishart"],
    )
    assert "By the paper's estimator it loses: -0.54 [-0.57, -0.51]." in text


def test_at_rest_the_exact_and_the_undetermined_are_named():
    text = said(
        rows(
            ("rest", "additive", 16.6, -0.289, -0.3, -0.28, False),
            ("rest", "wishart", 16.87, 0.0, 0.0, 0.0, True),
        ),
        ["wishart"],
    )
    assert (
        "exactly the truth are wishart" in text
        and "of the parameters of wishart" in text
        and "Farthest off is additive" in text
    )
