"""Verdict on new runs, also on a single one and of any motion, by an exported joint error law."""

from collections.abc import Iterable, Iterator

import numpy as np

from pipeline.models.exported import ExportedErrors
from pipeline.models.joint_error.samples import JointRun
from pipeline.tools.export.command import scores_by_horizon

FACTOR = 2.0  # greatest factor between predicted and measured standard deviation


def assessments_of_runs(
    runs: Iterable[JointRun], model: ExportedErrors, export: str
) -> Iterator[str]:
    """Yield the verdict on each of ``runs`` by a joint error law: predicted over measured standard
    deviation and coverage at three horizons, and the rank of its log score among the runs of the
    fit, which stand in the exported file.
    """
    law, known = model.law, model.record["runs"]
    for run in runs:
        model.require_period(1 / run.rate)
        scores, rows = scores_by_horizon(law, run)
        lines = []
        for horizon, score in scores.items():
            own = rows[rows["horizon"] == horizon]
            share = own["predicted_rad"] / own["measured_rad"]
            inside = np.average(own["one_sigma"], weights=own["count"])
            others = np.array([one["scores"][horizon] for one in known if horizon in one["scores"]])
            lower = (1 + np.sum(others <= score)) / (1 + len(others))
            lines.append((horizon, share.min(), share.max(), inside, score, lower, len(others)))
        if not lines:
            yield f"assess: {run.name}: no joint is commanded to move; nothing can be compared"
            continue
        near = all(1 / FACTOR <= low and high <= FACTOR for _, low, high, *_ in lines)
        behaves, none = ("behaves", "") if near else ("does NOT behave", "not ")
        head = f"assess: {run.name} {behaves} as the {len(known)} runs of {export}: predicted over"
        head += f" measured standard deviation is {none}from {1 / FACTOR:g} to {FACTOR:g} for each"
        text = [f"{head} joint and horizon; lag {1e3 * run.lag.mean():.3g} ms"]
        for horizon, low, high, inside, score, lower, count in lines:
            words = f"  {horizon}: {low:.2f} to {high:.2f} by joint; {100 * inside:.0f} % within"
            words += f" one standard deviation; {score:.4g} nats a joint and sample, as low or"
            text.append(f"{words} lower than {100 * lower:.0f} % of {count + 1} runs")
        yield "\n".join(text)
