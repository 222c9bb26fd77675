"""What the controls say in words: whether the truth is found where it is known, and what is then left of the paper's claim."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

CONSISTENTLY = ", consistent"


def control_section(scores: pd.DataFrame, matrix_models: Sequence[str]) -> str:
    """Sentences on ``scores``, the rows of ``tables/control_scores``."""
    lines = ["## Where the truth is known"]
    for true, rows in scores.groupby("true", sort=False):
        by_model = rows.set_index("fitted")
        lines.append(_rest(by_model) if true == "rest" else _truth(true, by_model, matrix_models))
    return "\n\n".join(lines)


def _truth(true: str, rows: pd.DataFrame, matrix_models: Sequence[str]) -> str:
    own = f"{true}{CONSISTENTLY}" if f"{true}{CONSISTENTLY}" in rows.index else true
    others = rows[[name.removesuffix(CONSISTENTLY) != true for name in rows.index]]
    best = others["log_score"].idxmax()
    beaten = others.index[others["low"] > rows.loc[own, "high"]]
    text = [
        f"Data drawn from **{true}**: fitted consistently it scores {_signed(rows.loc[own])} nats a step against the truth itself; "
        f"the best of the other models is {best} with {_signed(rows.loc[best])}."
    ]
    text.append(f"Better than the true one's own fit: {', '.join(beaten)}." if len(beaten) else "No other beats it beyond its interval.")
    if own != true and rows.loc[true, "high"] < rows.loc[own, "low"]:
        text.append(f"By the paper's estimator it loses: {_signed(rows.loc[true])}.")
    if true not in matrix_models:
        followers = [
            f"{model} {_signed(rows.loc[model])} nats, its standard deviation over time correlating {_correlations(rows.loc[model])} "
            "with the drawn one"
            for model in matrix_models
            if model in rows.index
        ]
        text.append(f"The paper's claim is then refuted, as it should be: {'; '.join(followers)} (joints 1 to 3).")
    return " ".join(text)


def _correlations(row: pd.Series) -> str:
    return ", ".join(f"{row[f'std_correlation_q{j}']:+.2f}" for j in (1, 2, 3))


def _rest(rows: pd.DataFrame) -> str:
    exact = rows.index[np.abs(rows["difference"]) < 1e-9]
    undetermined = rows.index[rows["undetermined"]]
    worst = rows["log_score"].idxmin()
    return (
        f"A **robot at rest**, nothing but measurement noise: exactly the truth are {'; '.join(exact) or 'none'}; the recordings say "
        f"nothing of the parameters of {'; '.join(undetermined) or 'none'}. Farthest off is {worst} with {_signed(rows.loc[worst])} nats."
    )


def _signed(row: pd.Series) -> str:
    return f"{row['difference']:+.3g} [{row['low']:+.3g}, {row['high']:+.3g}]"
