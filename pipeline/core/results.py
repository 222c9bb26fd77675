"""Folder of a run's results: a trial does not replace the results of a whole run."""

import json
from pathlib import Path

REPORTS = Path("reports")
TRIALS = REPORTS / "trials"  # not in git
EVIDENCE = "datasets"  # folder of a file for each dataset, which the report compares
SMOKE = "smoke"  # the scale of a trial, whose numbers decide nothing


def results_folder(dataset: str, scale: str) -> Path:
    """Return ``reports``, or ``reports/trials`` for a trial of a ``dataset`` with results of
    another scale.
    """
    if scale == SMOKE and _earlier_scale(dataset) not in (None, SMOKE):
        return TRIALS
    return REPORTS


def _earlier_scale(dataset: str) -> str | None:
    """Return the scale of the evidence in ``reports``, None if it is missing or unreadable."""
    try:
        text = (REPORTS / EVIDENCE / f"{dataset}.json").read_text(encoding="utf-8")
        return json.loads(text).get("scale")
    except (OSError, ValueError, AttributeError):
        return None
