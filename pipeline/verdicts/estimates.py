"""Published numbers beside the run's: parameters by estimator, and other numbers by dataset."""

from collections.abc import Mapping, Sequence

from pipeline.verdicts import decision as d
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.decision import Case, Verdict
from pipeline.verdicts.encoders import encoder_noise
from pipeline.verdicts.model_card import few_takes
from pipeline.verdicts.paper import noise_levels
from pipeline.verdicts.run import Run
from pipeline.verdicts.tally import Group
from pipeline.verdicts.wording import (
    MISSING,
    WORDS,
    interval,
    number,
    say,
    table,
)

ESTIMATORS: dict[str, str] = WORDS["estimators"]
PARAMETERS: dict[str, list[str]] = WORDS["parameters"]
INPUTS: dict[str, str] = WORDS["inputs"]


def published_and_ours(here: Run, groups: Sequence[Group]) -> str:
    """Return the fitted parameters of ``here`` by estimator, then the other published numbers and
    those of each run of the same arm.
    """
    group = next(group for group in groups if here.dataset in group.verdicts)
    verdicts = group.verdicts[here.dataset]
    published = {verdict.claim.id: verdict.claim.published for verdict in verdicts}
    fitted = here.metrics.get("fit_gaussian", {}) if here.arm.numbered else {}
    levels = noise_levels(fitted, published)
    few = few_takes(here)
    if levels:
        levels = levels | _determination(fitted)
    paragraphs = [say("published", few=few, levels=levels)]
    rows = _parameter_rows(here, published, levels, few)
    if rows:
        header = ["parameter", "published", *ESTIMATORS.values()]
        paragraphs.append(table(header, rows))
    paragraphs.append(_numbers(here, groups))
    return "\n\n".join(text for text in paragraphs if text)


def _determination(fitted: Mapping[str, float]) -> dict[str, list[str]]:
    """Return the names of the estimators whose û is ``unbounded`` and ``bounded``."""
    unbounded = []
    bounded = []
    for estimator, name in ESTIMATORS.items():
        at_end = fitted.get(f"u_{estimator}_unbounded")
        if at_end:
            unbounded.append(name)
        elif at_end is not None:
            bounded.append(name)
    return {"unbounded": unbounded, "bounded": bounded}


def _parameter_rows(
    here: Run,
    published: Mapping[str, object],
    levels: Mapping[str, float],
    few: bool,
) -> list[list[object]]:
    """Return name, published value and estimates of each fitted parameter."""
    rows = []
    for name, (file, key, claim) in PARAMETERS.items():
        fitted = here.metrics.get(file, {})
        cells = [_estimate(fitted, key, estimator, few) for estimator in ESTIMATORS]
        if {*cells} == {MISSING}:
            continue
        stated = published.get(claim, MISSING)
        if key == "noise_level" and levels:
            stated = f"{number(levels['published'])} (of û and α̂)"
        rows.append([name, stated, *cells])
    return rows


def _estimate(fitted: Mapping[str, float], key: str, estimator: str, few: bool) -> str:
    """Return an estimate with its interval, or "unbounded" at the end of the searched interval; the
    mean of a Wishart step ends at σ_B = 1 for every number of joints, its covariance before.
    """
    name = f"{key}_{estimator}"
    if fitted.get(f"{name}_unbounded"):
        return "unbounded"
    if name not in fitted:
        return MISSING
    text = number(fitted[name])
    ends = [fitted.get(f"{name}_interval_{end}") for end in ("low", "high")]
    if not few and None not in ends:
        text += f" {interval(*ends)}"
    limit = fitted.get("sigma_b_limit_of_the_covariance", float("inf"))
    if "sigma_b" not in key or fitted[name] < limit:
        return text
    lacks = "mean" if fitted[name] >= 1 else "covariance"
    return f"{text} (no {lacks})"


def _numbers(here: Run, groups: Sequence[Group]) -> str:
    """Return the table of the published numbers that are no parameters of a law, for each run of
    the arm of ``here`` and by the encoders of a real arm, with a word on the numbers that were
    inputs.
    """
    in_parameters = {claim for *_, claim in PARAMETERS.values()}
    independent = groups[0].verdicts[d.WITHOUT_RECORDING]
    columns = _columns(here, groups)
    runs = [run for group in groups for run in group.runs]
    encoders = encoder_noise(runs, here.joints if here.arm.numbered else ())
    rows = []
    for place, verdict in enumerate(independent):
        claim = verdict.claim
        if not claim.parameter or claim.id in in_parameters:
            continue
        by_run = [verdicts[place] for verdicts in columns.values()]
        if verdict.verdict != d.NO_RECORDING:  # it is of no dataset
            by_run = [verdict, *([None] * (len(by_run) - 1))]
        first, *of_other_runs = map(_cases, by_run)
        if not first:
            continue
        cells = [_values(first, few_takes(here))]
        cells += [_rounded([case.value for case in cases]) for cases in of_other_runs]
        if encoders is not None:
            cells.append(_rounded(encoders.values(claim.id, first)))
        is_input = INPUTS.get(claim.id, "no") if here.synthetic else "no"
        rows.append([*_name_and_published(claim, first), is_input, *cells])
    if not rows:
        return ""
    headings = [*columns]
    if encoders is not None:
        headings.append(f"{encoders.dataset} (real, encoders)")
    return table(["number", "published", "was it an input?", *headings], rows)


def _rounded(values: Sequence[float]) -> str:
    return "; ".join(number(value, 3) for value in values)


def _columns(here: Run, groups: Sequence[Group]) -> dict[str, Sequence[Verdict]]:
    """Return the verdicts of ``here`` and of the other runs of its arm, by heading."""
    first = {}
    columns = {}
    for group in groups:
        for run in group.runs:
            if run.dataset == here.dataset:
                first[_heading(run)] = group.verdicts[run.dataset]
            elif run.arm == here.arm:
                columns[_heading(run)] = group.verdicts[run.dataset]
    return first | columns


def _heading(run: Run) -> str:
    """Return the name of the dataset with the cause of its noise, or "real"."""
    if not run.synthetic:
        return f"{run.dataset} (real)"
    return f"{run.dataset} ({run.cause})" if run.cause else run.dataset


def _cases(verdict: Verdict | None) -> list[Case]:
    """Return the cases of a verdict that have a value."""
    if verdict is None or verdict.verdict == d.NO_RECORDING:
        return []
    return [case for case in verdict.cases if case.value is not None]


def _name_and_published(claim: Claim, cases: Sequence[Case]) -> tuple[str, str]:
    unit = f" ({claim.unit})" if claim.unit else ""
    names = "; ".join(case.case for case in cases if case.case)
    name = f"{claim.parameter}, {names}" if names else claim.parameter
    return name + unit, "; ".join(number(case.published) for case in cases)


def _values(cases: Sequence[Case], few: bool) -> str:
    """Return the values of the ``cases`` with their intervals, without if takes are ``few``."""
    texts = []
    for case in cases:
        text = number(case.value)
        if not few and case.low is not None:
            text += f" {interval(case.low, case.high)}"
        texts.append(text)
    return "; ".join(texts)
