"""What is left of the matrix models' advantage over models without a random matrix, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd


def advantage_section(dataset: str, differences: pd.DataFrame, matrix_models: Sequence[str], rivals: Sequence[str]) -> str:
    """One line per matrix model and group of steps of ``dataset``: against the first rival, the paper's, and the strongest of all.

    ``differences``: rows of ``tables/log_score_differences``. The strongest rival is the one whose difference to the model is least.
    """
    lines = [
        f"## What is left of the matrix models' advantage: {dataset}",
        f"Log scores in nats a step, paired over the takes, in brackets the 95 % interval. {_listed(rivals)} have no random matrix; "
        "a matrix model may beat additive noise of one size merely because it scales with the motion, which the others of them do too.",
    ]
    for steps, rows in differences.groupby("steps", sort=False):
        lines.append(f"**{steps[0].upper()}{steps[1:]}**")
        lines.append("\n".join(f"- {_line(model, rows[rows['model'] == model].set_index('rival'), rivals)}" for model in matrix_models))
    return "\n\n".join(lines)


def _line(model: str, rows: pd.DataFrame, rivals: Sequence[str]) -> str:
    known = rows.loc[[rival for rival in rivals if rival in rows.index and np.isfinite(rows.loc[rival, "difference"])]]
    if known.empty:
        return f"{model}: no score to compare."
    text = [_against(rival, known.loc[rival]) for rival in dict.fromkeys([known.index[0], known["difference"].idxmin()])]
    strongest = known.loc[known["difference"].idxmin()]
    left = "its advantage is left" if strongest["low"] > 0 else "nothing is left" if strongest["high"] < 0 else "nothing certain is left"
    return f"{model}: {', '.join(text)}: {left}."


def _against(rival: str, row: pd.Series) -> str:
    if not np.isfinite(row["low"]):
        return f"{row['difference']:+.3g} against {rival}"
    return f"{row['difference']:+.3g} [{row['low']:+.3g}, {row['high']:+.3g}] against {rival}"


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
