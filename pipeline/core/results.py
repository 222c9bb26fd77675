"""Folders of a run's evidence and pages: a trial does not replace those of a whole run."""

import json
from pathlib import Path

REPORTS = Path("reports")
TRIALS = REPORTS / "trials"  # not in git
EVIDENCE = "datasets"  # folder of a file for each dataset, which the report compares
SMOKE = "smoke"  # the scale of a trial, whose numbers decide nothing


def evidence_folder(dataset: str, scale: str) -> Path:
    """Return ``reports``, or ``reports/trials`` for a trial of a ``dataset`` with evidence of
    another scale.
    """
    if scale == SMOKE and _earlier_scale(dataset) not in (None, SMOKE):
        return TRIALS
    return REPORTS


def pages_folder(dataset: str, scale: str) -> Path:
    """Return ``reports``, or ``reports/trials`` for a trial of a ``dataset`` with pages of another
    scale. A clone has the evidence of datasets without their pages: there the first trial, and each
    after it until a whole run, writes the pages of ``reports``.
    """
    place = evidence_folder(dataset, scale)
    if place == REPORTS or (TRIALS / dataset).is_dir():
        return place
    has_pages = (REPORTS / dataset / "tables").is_dir()
    had_trial = (TRIALS / EVIDENCE / f"{dataset}.json").is_file()
    return REPORTS if had_trial or not has_pages else TRIALS


def _earlier_scale(dataset: str) -> str | None:
    """Return the scale of the evidence in ``reports``, None if it is missing or unreadable."""
    try:
        text = (REPORTS / EVIDENCE / f"{dataset}.json").read_text(encoding="utf-8")
        return json.loads(text).get("scale")
    except (OSError, ValueError, AttributeError):
        return None
