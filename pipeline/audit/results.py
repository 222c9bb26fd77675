"""The numbers of one run as a page that reads well and whose differences do: every one taken from a file that a stage wrote."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

Metrics = Mapping[str, Mapping[str, float]]


def number(value: float) -> str:
    """Four significant digits; counts as they are."""
    return f"{value:,.0f}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:.4g}"


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ["---"] * len(header), *rows])


def results_page(dataset: str, scale: str, models: list[str], metrics: Metrics, tables: Mapping[str, pd.DataFrame]) -> str:
    """``reports/results.md`` from the metrics (file stem → name → value) and small tables (file stem → rows) of a run."""
    sections = [
        f"# Results: dataset {dataset}, scale {scale}",
        "Written by the stage `report` from `reports/metrics` and `reports/tables`. Joint angles are in rad, forces in N.",
        "## Fitted parameters",
        *(f"**{model}** (`reports/metrics/fit_{model}.json`)\n\n{_values(metrics[f'fit_{model}'])}" for model in models),
        "## Models against recordings",
        "Greatest error of the mean, and the standard deviation of the process noise, root mean square over time.",
        _motion(models, metrics["motion"]),
        "How the realisations fared:",
        _side_by_side(models, {model: metrics[f"simulate_{model}"] for model in models}),
    ]
    if "one_step_scores" in tables:
        sections += [
            "## One-step predictions of the test takes",
            f"Means over the takes and, in brackets, the paired difference to {models[0]} with its 95 % interval. Log scores are best when "
            "great, energy scores when small; a calibrated normal law covers 0.683 within one sigma and 0.95 within its region, and has a "
            "NEES of 3. The measurement noise recorded at rest is added to every model alike unless the score says otherwise.",
        ]
        for steps, rows in tables["one_step_scores"].groupby("steps", sort=False):
            sections += [f"Steps: {steps}.", _comparison(models, rows)]
    if "filter_scores" in tables:
        sections += ["## Particle filter on the test takes", _frame(tables["filter_scores"])]
        sections += [
            "The posterior as a normal law, half the noise recorded at rest added, against the motion capture: means over the takes and, "
            f"in brackets, the paired difference to {models[0]} with its 95 % interval.",
            _comparison(models, tables["filter_comparison"]),
            "How the filters fared:",
        ]
        sections.append(_side_by_side(models, {model: metrics[f"filter_{model}"] for model in models}))
    sections += [
        "## Wrench: numerical study\n\nRelative error of the force's variances over the test systems.",
        _frame(tables["wrench_study"]),
    ]
    sections += [
        "Σ_S, diagonal and full: its mean over the systems (s), standard errors (se), expectation by quadrature (e) and that one's "
        "standard error (ee), and the eigenvalues held at zero:",
        _frame(tables["sigma_s"]),
    ]
    if "force_moments" in tables:
        sections += ["## Wrench: measured and modelled force", _frame(tables["force_moments"])]
        sections += [
            "Whether both have one law, by the energy distance (in N) and its permutation test, for either form of Σ_S and without it:",
            _frame(tables["force_test"]),
        ]
    sections += ["## What was lost, repaired or clipped", _frame(tables["recording_quality"])]
    left_out = [name for name, key in (("the particle filter", "filter_scores"), ("measured force", "force_moments")) if key not in tables]
    if left_out:
        sections.append(f"The dataset has no instrument for {' and '.join(left_out)}.")
    if "one_step_scores" not in tables:
        sections.append("No one-step prediction was scored: the dataset has no test takes, or its motion never rests.")
    return "\n\n".join(sections) + "\n"


def _values(values: Mapping[str, float]) -> str:
    return table(["quantity", "value"], [[name.replace("_", " "), number(value)] for name, value in values.items()])


def _frame(rows: pd.DataFrame) -> str:
    cells = rows.map(lambda cell: cell if isinstance(cell, str) else number(cell))
    return table([name.replace("_", " ") for name in rows.columns], cells.to_numpy().tolist())


def _comparison(models: list[str], rows: pd.DataFrame) -> str:
    """Scores down, models across; what does not exist is a dash."""

    def cell(row: pd.Series) -> str:
        value = "–" if np.isnan(row["mean"]) else number(row["mean"])
        if np.isnan(row["difference"]):
            return value
        interval = "" if np.isnan(row["low"]) else f" [{row['low']:+.4g}, {row['high']:+.4g}]"
        return f"{value} ({row['difference']:+.4g}{interval})"

    cells = {(row["score"], row["model"]): cell(row) for _, row in rows.iterrows()}
    scores = list(dict.fromkeys(rows["score"]))
    return table(["", *models], [[score.replace("_", " "), *(cells[score, model] for model in models)] for score in scores])


def _side_by_side(models: list[str], values: Mapping[str, Mapping[str, float]]) -> str:
    names = list(values[models[0]])
    return table(["", *models], [[name.replace("_", " "), *(number(values[model][name]) for model in models)] for name in names])


def _motion(models: list[str], motion: Mapping[str, float]) -> str:
    rows = [["greatest mean error", "", *(number(motion[f"{model}_greatest_mean_error_rad"]) for model in models)]]
    for j in (1, 2, 3):
        spread = [number(motion[f"{source}_std_q{j}_rms_rad"]) for source in ("recorded", *models)]
        rows.append([f"standard deviation, joint {j}", *spread])
        follows = [number(motion[f"{model}_std_q{j}_correlation_with_recorded"]) for model in models]
        rows.append([f"its correlation with the recorded one, joint {j}", "", *follows])
        off = [number(motion[f"{model}_std_q{j}_relative_error"]) for model in models]
        rows.append([f"its error relative to the recorded one, joint {j}", "", *off])
    return table(["", "recorded", *models], rows)
