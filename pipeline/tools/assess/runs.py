"""Verdict on new runs, also on a single one and of any motion, by an exported joint error law."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from jinja2 import Template

from pipeline.models.exported import ExportedErrors
from pipeline.models.joint_error.samples import JointRun
from pipeline.tools.export.command import scores_by_horizon

TEXT = Template(Path(__file__).with_name("run.txt").read_text(encoding="utf-8"), trim_blocks=True)
FACTOR = 2.0  # greatest factor between predicted and measured standard deviation


def assessments_of_runs(
    runs: Iterable[JointRun], model: ExportedErrors, export: str
) -> Iterator[str]:
    """Yield the verdict on each of ``runs`` by a joint error law: predicted over measured standard
    deviation and coverage at three horizons, and the rank of its log score among the runs of the
    fit, which stand in the exported file.
    """
    known = model.record["runs"]
    for run in runs:
        model.require_period(1 / run.rate)
        scores, all_rows = scores_by_horizon(model.law, run)
        rows = {}
        for horizon, score in scores.items():
            own = all_rows[all_rows["horizon"] == horizon]
            share = own["predicted_rad"] / own["measured_rad"]
            inside = np.average(own["one_sigma"], weights=own["count"])
            others = np.array([one["scores"][horizon] for one in known if horizon in one["scores"]])
            count = 1 + len(others)
            lower = (1 + np.sum(others <= score)) / count
            rows[horizon] = share.min(), share.max(), inside, score, lower, count
        if not rows:
            yield f"assess: {run.name}: no joint is commanded to move; nothing can be compared"
            continue
        columns = ["low", "high", "inside", "score", "lower", "count"]
        table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
        yield TEXT.render(run=run, rows=table, known=len(known), export=export, factor=FACTOR)
