"""The numbers of one run as a page that reads well and whose differences do: every one taken from a file that a stage wrote."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

Metrics = Mapping[str, Mapping[str, float]]

SPREAD = ("_standard_error", "_interval_low", "_interval_high")
STUDIES = {  # tables that speak for themselves under a heading
    "spread_comparison": (
        "Whether the spread follows the recorded one",
        "The standard deviation of one step over time: its correlation with the recorded one and its relative error, by joint, with the "
        "paired difference to the first model and the 95 % interval of the bootstrap over takes.",
    ),
    "bound_comparison": (
        "Whether the filter's bound follows its error",
        "Over time, by joint, with the paired difference to the first model and the 95 % interval of the bootstrap over takes.",
    ),
    "control_scores": (
        "Controls: the truth is known",
        "Every model fitted to noise drawn from a known model, or to a robot at rest, and scored on more of it: the log score, "
        "and its paired difference to that of the true law with its true parameters. Nothing can beat the truth; a claim that "
        "holds whatever the truth says nothing. The correlations say whether the model's standard deviation over time follows "
        "that of the drawn noise.",
    ),
    "parameter_recovery": (
        "Recovery: what each estimator returns of known parameters",
        "Data drawn with known parameters, fitted many times: the bias, and how often the bootstrap's interval covers the truth.",
    ),
    "sigma_b_choices": (
        "σ̂_B over the choices that the paper leaves open",
        "The paper's estimator over the ratio of its weights, in shares of the one used here, and over the floor of B⁻¹; on "
        "data drawn with a known σ_B too.",
    ),
}


def number(value: float) -> str:
    """Four significant digits; counts as they are; a dash for what does not exist."""
    if np.isnan(value):
        return "–"
    return f"{value:,.0f}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:.4g}"


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ["---"] * len(header), *rows])


def results_page(
    dataset: str, scale: str, models: list[str], metrics: Metrics, tables: Mapping[str, pd.DataFrame], opening: Sequence[str]
) -> str:
    """``reports/report.md`` from a run's metrics (file stem → name → value) and small tables (file stem → rows).

    ``opening``: the sections that come first, as Markdown.
    """
    sections = [
        f"# Results: dataset {dataset}, scale {scale}",
        "Written by the stage `report` from `reports/metrics` and `reports/tables`. Joint angles are in rad, forces in N.",
        *opening,
        "## Fitted parameters",
        "Standard errors and intervals are from the bootstrap over takes.",
        *(f"**{model}** (`reports/metrics/fit_{model}.json`)\n\n{_values(metrics[f'fit_{model}'])}" for model in models),
        "## Models against recordings",
        "Greatest error of the mean, and the standard deviation of the process noise, root mean square over time.",
        _motion(models, metrics["motion"]),
        "How the realisations fared:",
        _side_by_side(models, {model: metrics[f"simulate_{model}"] for model in models}),
    ]
    if "one_step_scores" in tables:
        sections += [
            "## One-step predictions of takes that were not fitted",
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
    sections += [part for name, (title, text) in STUDIES.items() if name in tables for part in (f"## {title}", text, _frame(tables[name]))]
    sections += [
        "## Wrench: numerical study\n\nRelative error of the force's variances over the test systems.",
        _frame(tables["wrench_study"]),
    ]
    sections += [
        "Σ_S, diagonal and full: its mean over the systems (s), standard errors (se), expectation by quadrature (e) and that one's "
        "standard error (ee), the standard error of a mean over as many systems, from the same points (de), and the "
        "eigenvalues held at zero:",
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
    """Quantities down; where a standard error and an interval belong to one, they stand beside it."""
    rows = []
    for name, value in values.items():
        if not name.endswith(SPREAD):
            error, low, high = (values.get(f"{name}{ending}", np.nan) for ending in SPREAD)
            rows.append([name.replace("_", " "), number(value), number(error), "" if np.isnan(low) else f"{number(low)} … {number(high)}"])
    return table(["quantity", "value", "standard error", "95 % interval"], rows)


def _frame(rows: pd.DataFrame) -> str:
    cells = rows.map(lambda cell: cell if isinstance(cell, str) else ("yes" if cell else "") if isinstance(cell, bool) else number(cell))
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
    names = list(dict.fromkeys(name for model in models for name in values[model]))
    cell = {model: [number(values[model].get(name, np.nan)) for name in names] for model in models}
    return table(["", *models], [[name.replace("_", " "), *(cell[model][row] for model in models)] for row, name in enumerate(names)])


def _motion(models: list[str], motion: Mapping[str, float]) -> str:
    def row(title: str, key: str, *, recorded: bool = False) -> list[str]:
        sources = ["recorded", *models] if recorded else models
        values = [number(motion.get(key.format(source), np.nan)) for source in sources]
        return [title, *([] if recorded else [""]), *values]

    rows = [row("greatest mean error", "{}_greatest_mean_error_rad")]
    for j in (1, 2, 3):
        rows.append(row(f"standard deviation, joint {j}", f"{{}}_std_q{j}_rms_rad", recorded=True))
        rows.append(row(f"its correlation with the recorded one, joint {j}", f"{{}}_std_q{j}_correlation_with_recorded"))
        rows.append(row(f"its error relative to the recorded one, joint {j}", f"{{}}_std_q{j}_relative_error"))
    return table(["", "recorded", *models], rows)
