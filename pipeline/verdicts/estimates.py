"""Fitted parameters by estimator and other numbers beside the published ones."""

from collections.abc import Mapping, Sequence

from pipeline.verdicts import decision as d
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.decision import Decided
from pipeline.verdicts.model_card import few_takes
from pipeline.verdicts.paper import noise_levels
from pipeline.verdicts.run import Run, index_evidence
from pipeline.verdicts.wording import MISSING, WORDS, interval, number, say, table


def estimates(here: Run, decided: Sequence[Decided]) -> str:
    """Return a sentence on σ̂_B by each estimator beside the published value, if it was fitted."""
    fitted, few = here.metrics.get("fit_wishart", {}), few_takes(here)
    cells = [
        f"{_estimate(fitted, 'sigma_b', estimator, few)} by {name}"
        for estimator, name in WORDS["estimators"].items()
        if f"sigma_b_{estimator}" in fitted
    ]
    published = [v.claim.published for v in decided[0].verdicts if v.claim.id == "sigma-b"]
    return say("dispersion", run=here, cells=cells, published=published[0]) if cells else ""


def published_and_ours(here: Run, decided: Sequence[Decided]) -> str:
    """Return the fitted parameters by estimator, then the other published numbers and ours."""
    few, without, estimators = few_takes(here), decided[-1], WORDS["estimators"]
    own = next(whose for whose in decided if whose.dataset == here.dataset)
    published = {verdict.claim.id: verdict.claim.published for verdict in own.verdicts}
    rows, others = [], []
    for name, (file, key, claim) in WORDS["parameters"].items():
        fitted = here.metrics.get(file, {})
        cells = [_estimate(fitted, key, estimator, few) for estimator in estimators]
        if {*cells} != {MISSING}:
            rows.append([name, published.get(claim, MISSING), *cells])
    levels = (
        noise_levels(here.metrics.get("fit_gaussian", {}), published) if here.arm.numbered else {}
    )
    if levels:
        rows[-1][1] = f"{number(levels['published'])} (of û and α̂)"
    for pair in zip(own.verdicts, without.verdicts, strict=True):
        claim, _, cases = next(each for each in pair if each.verdict != d.NO_RECORDING)
        cases = [case for case in cases if case.value is not None]
        shown = claim.id in {each for *_, each in WORDS["parameters"].values()}
        if claim.parameter and cases and not shown:
            unit = f" ({claim.unit})" if claim.unit else ""
            names = " / ".join(filter(None, (case.case for case in cases)))
            name = ", ".join(filter(None, [claim.parameter, names])) + unit
            printed = " / ".join(number(case.published) for case in cases)
            ends = ["" if few or c.low is None else " " + interval(c.low, c.high) for c in cases]
            ours = [number(case.value) + end for case, end in zip(cases, ends, strict=True)]
            others.append([name, printed, " / ".join(ours) + _errors(here, claim)])
    parts = [say("published", few=few, levels=levels)]
    parts += [table(["parameter", "published", *estimators.values()], rows)] if rows else []
    parts += [table(["number", "published", here.dataset], others)] if others else []
    return "\n\n".join(parts)


def _errors(here: Run, claim: Claim) -> str:
    """Return the greatest of each of the errors that add in squares, if there are several."""
    rows, errors = index_evidence(here.evidence), []
    for error in claim.standard_errors if len(claim.standard_errors) > 1 else ():
        found = [error.look_up(rows, case) for case in claim.cases(here.arm)]
        errors.append(number(max(filter(None, found), default=float("nan")), 3))
    words = " (standard errors up to: sampling {}, which decides, and quadrature {})"
    return words.format(*errors) if errors else ""


def _estimate(fitted: Mapping[str, float], key: str, estimator: str, few: bool) -> str:
    """Return an estimate with its interval, or "unbounded" at the end of the searched interval."""
    name = f"{key}_{estimator}"
    if fitted.get(f"{name}_unbounded"):
        return "unbounded"
    if name not in fitted:
        return MISSING
    ends = [fitted.get(f"{name}_interval_{end}") for end in ("low", "high")]
    text = number(fitted[name])
    text = text if few or None in ends else f"{text} {interval(*ends)}"
    limit = fitted.get("sigma_b_limit_of_the_covariance", float("inf"))
    return f"{text} (no covariance)" if "sigma_b" in key and fitted[name] >= limit else text
