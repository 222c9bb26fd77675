"""The finding in a sentence a result, from the evidence of all datasets."""

from collections.abc import Sequence

import pandas as pd

from pipeline.core.filters import SPEED
from pipeline.verdicts.encoders import encoder_sentence
from pipeline.verdicts.scores import ADDITIVE, MATRIX_KINDS, log_scores, pairs_of
from pipeline.verdicts.tally import (
    COUNTED,
    DEPENDS,
    FAILS,
    HOLDS,
    SPEED_LAW,
    Group,
    Row,
)
from pipeline.verdicts.wording import join_names, plain_name, say


def finding(groups: Sequence[Group], rows: Sequence[Row]) -> list[str]:
    """Return the sentences of the finding: what was reproduced, what the recordings would have to
    decide, how large the published noise is, what real robots say, what the printed estimators
    determine, and what to use instead. A sentence without its numbers is left out.
    """
    sentences = [
        _independent(rows),
        _synthetic(rows),
        encoder_sentence(groups),
        _real(groups),
        _estimators(groups),
        say("finding_use"),
    ]
    return [sentence for sentence in sentences if sentence]


def rounded(value: float) -> str:
    """Return the size of ``value`` with three significant digits, whole from 100."""
    size = float(f"{abs(value):.3g}")
    return f"{size:,.0f}" if size >= 100 else f"{size:.3g}"


def _independent(rows: Sequence[Row]) -> str:
    """Return the sentence on the claims that need no recording."""
    independent = [row for row in rows if not row.group.runs]
    if not independent:
        return ""
    claims = independent[0].claims
    counts = {word: len(claims[word]) for word in COUNTED}
    failing = [joined.claim.id for joined in claims[FAILS]]
    decided = counts[HOLDS] + counts[FAILS]
    return say("finding_wrench", holds=counts[HOLDS], decided=decided, failing=failing)


def _synthetic(rows: Sequence[Row]) -> str:
    """Return the sentence on claims about robots in the synthetic group with most causes."""
    synthetic = [row for row in rows if not row.decides]
    if not synthetic:
        return ""
    row = max(synthetic, key=lambda row: len({*row.group.cause_of.values()}))
    counts = {word: len(row.claims[word]) for word in COUNTED}
    words = {
        "causes": len({*row.group.cause_of.values()}),
        "holds": counts[HOLDS],
        "speed_law": counts[SPEED_LAW],
        "fails": counts[FAILS],
        "depends": counts[DEPENDS],
    }
    return say("finding_synthetic", **words)


def _real(groups: Sequence[Group]) -> str:
    """Return the sentence on the log scores of the matrix models on real robots, against constant
    noise and against the law of the speed.
    """
    by_model: dict[str, dict[str, pd.Series]] = {}
    leading = []
    for group in groups:
        run = group.runs[0] if group.runs else None
        if run is None or run.synthetic or "predictions" not in run.tables:
            continue
        robot = group.robot
        pairs = pairs_of(run)
        models = [name for name, kind in run.models.items() if kind in MATRIX_KINDS]
        scored = [model for model in models if (model, ADDITIVE) in pairs.index]
        for model in scored:
            difference = pairs.loc[(model, ADDITIVE)]
            if pd.notna(difference["difference"]):
                by_model.setdefault(plain_name(model), {})[robot] = difference
        means = log_scores(run)["mean"]
        matrix = [means[model] for model in scored if model in means]
        if SPEED in means and means[SPEED] > max(matrix, default=float("inf")):
            leading.append(robot)
    if not by_model:
        return ""
    clauses = []
    higher = []
    for name, by_robot in by_model.items():
        clauses.append(_against_constant(name, by_robot))
        if any(difference["low"] > 0 for difference in by_robot.values()):
            higher.append(name)
    return say("finding_real", clauses=clauses, higher=higher, leading=leading)


def _against_constant(model: str, by_robot: dict[str, pd.Series]) -> str:
    """Return the clause on one matrix model: differences beyond their intervals, by robot."""
    sides: dict[str, list[str]] = {"lower": [], "higher": [], "": []}
    for robot, difference in by_robot.items():
        if difference["high"] < 0:
            side = "lower"
        elif difference["low"] > 0:
            side = "higher"
        else:
            side = ""
        size = f"{rounded(difference['difference'])} ({robot})"
        sides[side].append(size if side else robot)
    parts = [
        f"{side} by {join_names(sides[side])} nats"
        for side in ("lower", "higher")
        if sides[side]
    ]
    if sides[""]:
        parts.append(f"not significantly different on {join_names(sides[''])}")
    return f"{' and '.join(parts)} under the {model}"


def _estimators(groups: Sequence[Group]) -> str:
    """Return the sentence on σ̂_B over the bound ε, of the arm with most causes: the paper's."""
    by_causes = sorted(groups, key=lambda group: -len({*group.cause_of.values()}))
    for run in (run for group in by_causes for run in group.runs):
        fitted = run.metrics.get("fit_wishart", {})
        if "sigma_b_least_over_floors" in fitted:
            published = _published(groups)
            numbers = {
                "least": rounded(fitted["sigma_b_least_over_floors"]),
                "greatest": rounded(fitted["sigma_b_greatest_over_floors"]),
                "moments": rounded(fitted.get("sigma_b_moments", float("nan"))),
            }
            return say("finding_estimators", published=published, **numbers)
    return ""


def _published(groups: Sequence[Group]) -> float | None:
    """Return the published σ̂_B."""
    for verdict in next(iter(groups[0].verdicts.values())):
        if verdict.claim.id == "sigma-b":
            return verdict.claim.published
    return None
