"""The page of the study: which estimators return the truth, and whether anything beats it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline.core.columns import columns, members
from pipeline.studies import page
from pipeline.studies.recovery.controls import CONSISTENTLY, REST
from pipeline.verdicts.run import MATRIX_KINDS
from pipeline.verdicts.wording import table

TITLE = "Where the truth is known"
ASKED = """Do the estimators return the parameters that their data were drawn with, and hold their
intervals what they promise? Does any model beat the law that the data come from, in which case a
score would say nothing? Data have the poses and commands of the recordings, and noise drawn anew
from a model with known parameters, with the measurement noise of the recordings. Of a real robot
nobody knows the law; here it is known."""
BIASED = 0.1  # of a parameter, in shares of it


def sections(
    parameter_recovery: pd.DataFrame,
    sigma_b_choices: pd.DataFrame,
    control_scores: pd.DataFrame,
    kinds: Mapping[str, str],
) -> list[str]:
    """The page's sections from the study's tables; ``kinds`` of the run's models by name."""
    links = [
        page.write_csv(table, "recovery", name)
        for name, table in {
            "parameter_recovery": parameter_recovery,
            "sigma_b_choices": sigma_b_choices,
            "control_scores": control_scores,
        }.items()
    ]
    matrix_models = [name for name, kind in kinds.items() if kind in MATRIX_KINDS]
    return [
        ASKED,
        "## Answer",
        _estimators(parameter_recovery),
        *controls(control_scores, matrix_models),
        f"All numbers: {', '.join(links)}.",
        "## Parameters",
        page.figure("recovery", "parameter_recovery"),
        _recovered(parameter_recovery),
        "## The paper's estimate of the dispersion",
        _dispersion(sigma_b_choices),
        page.figure("recovery", "sigma_b_choices"),
        "## Scores where the law is known",
        "Mean log score of a held-out step in nats, its paired difference to that of the true law "
        "with its true parameters, and the 95 % interval over the takes.",
        _scored(control_scores),
    ]


def _estimators(rows: pd.DataFrame) -> str:
    """Which estimators are off by more than BIASED in a parameter that is not a covariance."""
    worst = rows.loc[rows.groupby("estimator", sort=False)["relative_bias"].apply(_greatest)]
    biased = worst[worst["relative_bias"].abs() > BIASED]
    off = [
        f"{row.estimator} ({row.parameter} by {100 * row.relative_bias:+.0f} %)"
        for row in biased.itertuples()
    ]
    right = [name for name in worst["estimator"] if name not in set(biased["estimator"])]
    return (
        f"Within {100 * BIASED:.0f} % of every true parameter on average: "
        f"{page.listed(right) or 'no estimator'}. Farther off in one at least: "
        f"{page.listed(off) or 'none'}."
    )


def _greatest(bias: pd.Series) -> object:
    return bias.abs().idxmax()


def _recovered(rows: pd.DataFrame) -> str:
    """Of every estimator and law the parameter that is farthest off, and the least coverage."""
    lines = []
    for (data, estimator), group in rows.groupby(["data", "estimator"], sort=False):
        worst = group.loc[_greatest(group["relative_bias"])]
        least = group.loc[group["coverage"].idxmin()]
        lines.append(
            [
                data,
                estimator,
                worst["parameter"],
                f"{100 * worst['relative_bias']:+.1f} %",
                f"{100 * least['coverage']:.0f} % ({least['parameter']})",
            ]
        )
    header = ["drawn from", "estimator", "parameter farthest off", "its bias", "least coverage"]
    return table(header, lines)


def _dispersion(rows: pd.DataFrame) -> str:
    """What the paper's estimator makes of known dispersions, at its own choices."""
    own = rows[(rows["varied"] == "ratio") & np.isclose(rows["share"], 1.0)]
    drawn = own[own["source"] == "drawn"]
    clean = own[own["source"] == "drawn without measurement noise"].set_index("truth")
    parts = [
        f"σ_B = {row.truth:g} as {row.sigma_b:.3g} (without measurement noise as "
        f"{clean.loc[row.truth, 'sigma_b']:.3g})"
        for row in drawn.drop_duplicates("truth").itertuples()
    ]
    recorded = own.loc[own["source"] == "recorded", "sigma_b"].iloc[0]
    return (
        f"With the weights and the floor used here the paper's estimator returns "
        f"{page.listed(parts)}; of the recordings it says {recorded:.3g}."
    )


def controls(scores: pd.DataFrame, matrix_models: list[str]) -> list[str]:
    """A paragraph for every known law of the table ``control_scores``."""
    paragraphs = []
    for true, rows in scores.groupby("true", sort=False):
        by_model = rows.set_index("fitted")
        at_rest = true == REST
        paragraphs.append(_rest(by_model) if at_rest else _truth(true, by_model, matrix_models))
    return paragraphs


def _truth(true: str, rows: pd.DataFrame, matrix_models: list[str]) -> str:
    own = f"{true}{CONSISTENTLY}" if f"{true}{CONSISTENTLY}" in rows.index else true
    others = rows[[name.removesuffix(CONSISTENTLY) != true for name in rows.index]]
    best = others["log_score"].idxmax()
    beaten = others.index[others["low"] > rows.loc[own, "high"]]
    text = [
        f"Data drawn from **{true}**: fitted consistently it scores {_difference(rows.loc[own])} "
        "nats a step against the truth itself; "
        f"the best of the other models is {best} with {_difference(rows.loc[best])}."
    ]
    text.append(
        f"Better than the true one's own fit: {page.listed(list(beaten))}."
        if len(beaten)
        else "No other beats it beyond its interval."
    )
    if own != true and rows.loc[true, "high"] < rows.loc[own, "low"]:
        text.append(f"By the paper's estimator it loses: {_difference(rows.loc[true])}.")
    if true not in matrix_models:
        followers = [
            f"{model} {_difference(rows.loc[model])} nats, its standard deviation over time "
            f"correlating {_correlations(rows.loc[[model]])} with the drawn one"
            for model in matrix_models
            if model in rows.index
        ]
        text.append(
            f"The paper's claim is then refuted, as it should be: {'; '.join(followers)} (joints "
            "base to tip)."
        )
    return " ".join(text)


def _rest(rows: pd.DataFrame) -> str:
    exact = rows.index[np.abs(rows["difference"]) < 1e-9]
    undetermined = rows.index[rows["undetermined"]]
    worst = rows["log_score"].idxmin()
    return (
        "A **robot at rest**, nothing but measurement noise: exactly the truth are "
        f"{'; '.join(exact) or 'none'}; the recordings say "
        f"nothing of the parameters of {'; '.join(undetermined) or 'none'}. Farthest off is "
        f"{worst} with {_difference(rows.loc[worst])} nats."
    )


def _correlations(row: pd.DataFrame) -> str:
    names = columns("std_correlation", members(row, "std_correlation"))
    return ", ".join(f"{value:+.2f}" for value in row[names].iloc[0])


def _difference(row: pd.Series) -> str:
    return page.interval(row["difference"], row["low"], row["high"])


def _scored(scores: pd.DataFrame) -> str:
    """Models down, laws across."""
    trues = list(dict.fromkeys(scores["true"]))
    cells = {(row["true"], row["fitted"]): row for _, row in scores.iterrows()}
    rows = [
        [model, *[_difference(cells[true, model]) for true in trues]]
        for model in dict.fromkeys(scores["fitted"])
    ]
    return table(["fitted", *[f"drawn from {true}" for true in trues]], rows)
