"""The page of the study: what is left of the matrix models' advantage over models without a random
matrix, of every dataset.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.studies import page
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import table

TITLE = "What is left of the matrix models' advantage"
FILTERED = "posterior of the particle filter"
FILTERED_CLOSED = "posterior of the particle filter, closed loop"
SCORE = "log_score"
NOTHING = "No prediction was scored: the motion of the dataset never rests."


def sections(runs: Sequence[Run], baselines: Sequence[str]) -> list[str]:
    """The page's sections: the dataset analysed first, whose figure is shown; ``baselines`` are the
    models without a random matrix beside the paper's additive one.
    """
    question = (
        "The paper compares its two matrix models with additive noise of one size, which must lose "
        "wherever the noise grows with the motion. Does a random matrix say more than a covariance "
        f"that merely scales with the commanded motion? {page.listed(list(baselines))} scale so, "
        "without a matrix (`pipeline/models/scaled`). Held-out steps are predicted by every model "
        "and scored by the log density of the pose that was measured, in nats a step, greater is "
        "better; so are the posteriors of the particle filter in both loops, and beside them none: "
        "the training takes' mean and spread at each step. Brackets hold 95 % intervals of "
        "paired differences over the takes. ‖J⁻¹‖ is great near singular poses."
    )
    return [
        question,
        "## Answer",
        *[f"**{run.dataset}.** {answer(run)}" for run in runs],
        page.figure("baselines", "model_scores"),
        *[part for run in runs for part in (f"## {run.dataset}", scores_table(run), *_left(run))],
    ]


def answer(run: Run) -> str:
    """What is left for each matrix model, over all groups of steps of a dataset."""
    texts = []
    for model in run.matrix_models:
        lines = {steps: _verdict(model, rows, run.rivals) for steps, rows in _groups(run)}
        kept = [steps for steps, (_, word) in lines.items() if word == LEFT]
        if not lines:
            texts.append(f"{model}: no score to compare.")
        elif len(kept) == len(lines):
            texts.append(f"{model} beats every model without a matrix, on all groups of steps.")
        elif kept:
            texts.append(f"{model} beats every model without a matrix on {page.listed(kept)}.")
        else:
            rivals = {rival for rival, word in lines.values() if word == LOST and rival}
            share = sum(word == LOST for _, word in lines.values())
            texts.append(
                f"{model} beats the best model without a matrix nowhere, and loses to "
                f"{page.listed(sorted(rivals)) or 'none'} on {share} of {len(lines)} groups."
            )
    return " ".join(texts)


LEFT, LOST, OPEN = "its advantage is left", "nothing is left", "nothing certain is left"


def _groups(run: Run) -> list[tuple[str, pd.DataFrame]]:
    if "log_score_differences" not in run.tables:
        return []
    return list(run.tables["log_score_differences"].groupby("steps", sort=False))


def _known(model: str, rows: pd.DataFrame, rivals: Sequence[str]) -> pd.DataFrame:
    """Of the rows against ``rivals`` in their order those that have a difference."""
    own = rows[rows["model"] == model].set_index("rival")
    own = own.loc[[rival for rival in rivals if rival in own.index]]
    return own[np.isfinite(own["difference"])]


def _verdict(model: str, rows: pd.DataFrame, rivals: Sequence[str]) -> tuple[str | None, str]:
    """The strongest rival, whose difference is least, and what it leaves of the advantage."""
    known = _known(model, rows, rivals)
    if known.empty:
        return None, OPEN
    rival = known["difference"].idxmin()
    low, high = known.loc[rival, ["low", "high"]]
    return rival, LEFT if low > 0 else LOST if high < 0 else OPEN


def _left(run: Run) -> list[str]:
    """A line for each matrix model and group of steps: against the first rival, the paper's, and
    the strongest of all.
    """
    lines = [
        f"- {steps}: {line(model, rows, run.rivals)}"
        for steps, rows in _groups(run)
        for model in run.matrix_models
    ]
    return ["\n".join(lines)] if lines else []


def line(model: str, rows: pd.DataFrame, rivals: Sequence[str]) -> str:
    """What is left for ``model`` on one group of steps, ``rows`` of ``log_score_differences``."""
    known = _known(model, rows, rivals)
    if known.empty:
        return f"{model}: no score to compare."
    strongest, word = _verdict(model, rows, rivals)
    text = [
        f"{page.interval(*known.loc[rival, ['difference', 'low', 'high']])} against {rival}"
        for rival in dict.fromkeys([known.index[0], strongest])
    ]
    return f"{model}: {', '.join(text)}: {word}."


def scores_table(run: Run) -> str:
    """Groups of steps down, models across: the first model's own score, and every other's
    difference to it.
    """
    if "model_scores" not in run.tables:
        return NOTHING
    rows = run.tables["model_scores"]
    rows = rows[rows["score"] == SCORE]
    models = list(dict.fromkeys(rows["model"]))
    cells = {(row["steps"], row["model"]): row for _, row in rows.iterrows()}
    return table(
        ["steps", *models],
        [
            [steps, *[_cell(cells.get((steps, model))) for model in models]]
            for steps in dict.fromkeys(rows["steps"])
        ],
    )


def _cell(row: pd.Series | None) -> str:
    if row is None or np.isnan(row["mean"]):
        return "–"
    if np.isnan(row["difference"]):
        return page.number(row["mean"])
    return page.interval(row["difference"], row["low"], row["high"])
