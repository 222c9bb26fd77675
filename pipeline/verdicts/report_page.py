"""The report: which claims hold and which do not, the paper's numbers beside ours, its figures and
gravest errata, on one page; and the other datasets on a second one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from pipeline.verdicts.claims import PROJECT
from pipeline.verdicts.decision import (
    FORCED,
    NO_RECORDING,
    NOT_REPRODUCED,
    REPRODUCED,
    WITHOUT_RECORDING,
    Case,
    Decided,
    Verdict,
)
from pipeline.verdicts.equations import Item, Source
from pipeline.verdicts.errata import Erratum
from pipeline.verdicts.filters import verdict as filter_verdict
from pipeline.verdicts.model_card import choice
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import (
    KEY,
    MARKS,
    case_text,
    interval,
    number,
    statement,
    table,
    verdict_cell,
)

# datasets that have a column, one a robot, and the robot; a dataset that is tried out has none
ROBOTS = {"youbot": "youBot, synthetic", "ur5": "UR5, real", "lwr4": "LWR4+, real"}
GRAVEST = (
    "sign-of-omega",
    "which-decomposition",
    "weights-not-given",
    "objective-not-bounded",
    "mean-of-the-inverse",
    "isotropic",
)
SMOKE = "smoke"  # the scale of a trial run, whose numbers decide nothing
FEW_TAKES = 10  # below it an interval from resampled takes is not printed
WHOSE = {
    "none": "computations without a recording",
    "synthetic": "synthetic recordings",
    "real": "recordings of a real robot, not the paper's",
    "paper": "the paper's own recordings",
}
LIMITS = (
    "Nobody has published the paper's recordings: the youBot's come from a synthetic laboratory "
    "whose physics is none of the models. The UR5's and the LWR4+'s are logs of real robots, which "
    "decide nothing about the paper's own arm."
)
# parameters: name, file and key; each estimator has the key with its own name behind it
ESTIMATORS = {"paper": "the paper's estimator", "moments": "moments", "likelihood": "likelihood"}
PARAMETERS = (
    ("σ̂_B", "fit_wishart", "sigma_b", "sigma-b"),
    ("σ̂_B, QR of Jᵀ (control)", "fit_wishart", "control_qr_transposed_sigma_b", ""),
    ("û", "fit_gaussian", "u", "u"),
    ("α̂", "fit_gaussian", "alpha", "alpha"),
    ("α̂û", "fit_gaussian", "noise_level", ""),
)
# numbers of summary.json by model and name of its estimate
SUMMARY = {"sigma_b": ("wishart", "sigma_b"), "alpha_u": ("gaussian", "noise_level")}
# counts of what was not solved, lost, clipped or left out
LOST = re.compile(r"lost|clipped|without|outside|_on_the_bound|end_of_its_interval")
LINKS = """\
- [model_card.md](model_card.md): which model to use for this arm, where and how surely.
- [claims.yaml](../claims.yaml): each claim with its test and reason; [claims.json](claims.json):
  numbers, verdicts and commands that recompute them; [datasets.md](../datasets.md): every dataset.
- [equations.md](../equations.md): each item of the paper in code and tests; [errata.md](errata.md).
- [recordings.md](recordings.md), [metrics](metrics), [tables](tables): this run.
- [studies](../studies): beyond the paper."""


def report_page(here: Run, decided: Sequence[Decided], parts: Sequence[tuple[str, str]]) -> str:
    """``report.md`` of the run ``here``: the result, a row a claim, then ``parts``, each a
    heading and its text; a part without text is left out.
    """
    sections = [f"# Results: dataset {here.dataset}, scale {here.scale}"]
    if here.scale == SMOKE:
        sections.append("**A trial run on the scale smoke: its numbers decide nothing.**")
    else:
        sections += [f"{LIMITS} {summary(here, decided)}", claims_table(here, decided)]
    sections += [f"## {title}\n\n{text}" for title, text in parts if text]
    return "\n\n".join(sections) + "\n"


def summary(here: Run, decided: Sequence[Decided]) -> str:
    """Counts of verdicts and what predicts and filters the motion of ``here``, a sentence each."""
    counts = [
        f"{ROBOTS.get(whose.dataset, whose.dataset)}: {_counted(whose.verdicts)}"
        for whose in _columns(here, decided)
    ]
    sentences = [f"Claims of the paper that hold / fail: {'; '.join(counts)}."]
    if "predictions" in here.tables:
        sentences.append(choice(here))
    return " ".join(filter(None, [*sentences, filter_verdict(here)]))


def _counted(verdicts: Sequence[Verdict]) -> str:
    verdict = [each.verdict for each in verdicts if each.claim.source != PROJECT]
    return f"{verdict.count(REPRODUCED)} / {verdict.count(NOT_REPRODUCED)}"


def summary_numbers(here: Run, decided: Sequence[Decided]) -> dict[str, float]:
    """Return at most seven numbers of the run ``here`` that are compared between experiments.

    Number of claims of the paper that hold and that fail (none on the scale smoke), σ̂_B, α̂û, and
    the log score of the next pose (nats a step) by each of the first three models.
    """
    numbers = {}
    if here.scale != SMOKE:
        own = next(whose for whose in decided if whose.dataset == here.dataset)
        hold, fail = _counted(own.verdicts).split(" / ")
        numbers |= {"hold": int(hold), "fail": int(fail)}
    for name, (model, key) in SUMMARY.items():
        if key in here.metrics.get(f"fit_{model}", {}):
            numbers[name] = here.metrics[f"fit_{model}"][key]
    if "predictions" in here.tables:
        rows = here.tables["predictions"].query("steps == 'all' and score == 'log_score'")
        means = rows.set_index("model")["mean"].dropna()
        numbers |= {f"log_{name}": means[name] for name in [*here.models][:3] if name in means}
    return numbers


def _columns(here: Run, decided: Sequence[Decided]) -> list[Decided]:
    """The verdicts without a recording, those of ``here``, then those of the other robots."""
    by_name = {whose.dataset: whose for whose in decided}
    names = dict.fromkeys([WITHOUT_RECORDING, here.dataset, *ROBOTS])
    return [by_name[name] for name in names if name in by_name]


def claims_table(here: Run, decided: Sequence[Decided]) -> str:
    """A row for each claim, of the paper first, with its verdict in every column."""
    columns = _columns(here, decided)
    rows = list(zip(*(whose.verdicts for whose in columns), strict=True))
    rows.sort(key=lambda row: row[0].claim.source == PROJECT)
    body = [[statement(row[0].claim), *map(verdict_cell, row)] for row in rows]
    header = ["claim", *(ROBOTS.get(whose.dataset, whose.dataset) for whose in columns)]
    return f"{table(header, body)}\n\n{KEY}"


def failures(here: Run, decided: Sequence[Decided]) -> str:
    """A line for each claim that fails in a column: the test, the first failing case, how many fail
    and the reason where one is written.
    """
    lines = []
    columns = _columns(here, decided)
    for row in zip(*(whose.verdicts for whose in columns), strict=True):
        for whose, verdict in zip(columns, row, strict=True):
            if verdict.verdict != NOT_REPRODUCED:
                continue
            claim = verdict.claim
            failing = [case for case in verdict.cases if case.holds is False]
            more = f" and {len(failing) - 1} more cases" if len(failing) > 1 else ""
            reason = f" Reason: {claim.why[whose.dataset]}." if whose.dataset in claim.why else ""
            lines.append(
                f"- **{claim.id}** on {whose.dataset}: {claim.quantity}, "
                f"{case_text(failing[0]).removesuffix(' ✗')}{more}; test: {claim.test}.{reason}"
            )
    return "\n".join(lines)


def published_and_ours(here: Run, decided: Sequence[Decided]) -> str:
    """The fitted parameters by every estimator, then each other number that the paper publishes
    beside that of ``here``.
    """
    few = here.metrics.get("motion", {}).get("recorded_takes", FEW_TAKES) < FEW_TAKES
    own = next(whose for whose in decided if whose.dataset == here.dataset)
    claims = {verdict.claim.id: verdict.claim for verdict in own.verdicts}
    rows = []
    for name, file, key, claim in PARAMETERS:
        fitted = here.metrics.get(file, {})
        cells = [_estimate(fitted, key, estimator, few) for estimator in ESTIMATORS]
        if any(cell != "–" for cell in cells):
            printed = number(claims[claim].published) if claim in claims else "–"
            rows.append([name, printed, *cells])
    fitted = table(["parameter", "published", *ESTIMATORS.values()], rows) if rows else ""
    others, without = [], next(w for w in decided if w.dataset == WITHOUT_RECORDING)
    estimated = {claim for *_, claim in PARAMETERS}
    for verdicts in zip(own.verdicts, without.verdicts, strict=True):
        verdict = next(v for v in verdicts if v.verdict != NO_RECORDING)
        claim = verdict.claim
        if not claim.parameter or claim.id in estimated:
            continue
        cases = [case for case in verdict.cases if case.value is not None]
        if cases:
            unit = f" ({claim.unit})" if claim.unit else ""
            names = " / ".join(filter(None, (case.case for case in cases)))
            name = ", ".join(filter(None, [claim.parameter, names])) + unit
            printed = " / ".join(number(case.published) for case in cases)
            others.append([name, printed, " / ".join(_ours(case, few) for case in cases)])
    numbers = table(["number", "published", here.dataset], others) if others else ""
    words = "No interval: fewer than ten takes." if few else "In brackets 95 % intervals."
    return "\n\n".join(filter(None, [words, fitted, numbers]))


def _ours(case: Case, few: bool) -> str:
    ends = "" if few or case.low is None else " " + interval(case.low, case.high)
    return number(case.value) + ends


def _estimate(fitted: Mapping[str, float], key: str, estimator: str, few: bool) -> str:
    """One estimate with its interval; a bound at the end of its search is no estimate, and σ_B
    beyond its limit gives a step no covariance.
    """
    name = f"{key}_{estimator}"
    if name not in fitted:
        return "–"
    if fitted.get(f"{name}_unbounded", fitted.get(f"{key}_unbounded", 0)):
        return "unbounded"
    ends = [fitted.get(f"{name}_interval_{end}") for end in ("low", "high")]
    text = number(fitted[name])
    text = text if few or None in ends else f"{text} {interval(*ends)}"
    limit = fitted.get("sigma_b_limit_of_the_covariance", float("inf"))
    return f"{text}, no covariance" if "sigma_b" in key and fitted[name] >= limit else text


def datasets_page(decided: Sequence[Decided]) -> str:
    """Return ``reports/datasets.md``: the verdict on every claim from every dataset as a sign."""
    decided = sorted(decided, key=lambda whose: (whose.recordings == "none", whose.dataset))
    rows = [
        [row[0].claim.id, *(MARKS[verdict.verdict] for verdict in row)]
        for row in zip(*(whose.verdicts for whose in decided), strict=True)
    ]
    forced = [str(sum(v.verdict == FORCED for v in whose.verdicts)) for whose in decided]
    tally = [
        [whose.dataset, WHOSE[whose.recordings], _counted(whose.verdicts), count]
        for whose, count in zip(decided, forced, strict=True)
    ]
    sections = [
        "# Every claim in every dataset",
        "Written by the stage `report` from [claims.yaml](claims.yaml); all numbers are in the "
        "file `claims.json` of a dataset's reports. Claims of the project are not counted.",
        table(["dataset", "recordings", "hold / fail", "by construction"], tally),
        table(["claim", *(whose.dataset for whose in decided)], rows),
        KEY.partition(" After")[0],
    ]
    return "\n\n".join(sections) + "\n"


def recordings_page(here: Run) -> str:
    """Return ``recordings.md``: found, kept, lost and repaired parts of the recordings."""
    parts = {"Kept and left out": kept(here), "Lost and repaired": counts(here)}
    sections = [f"# Recordings of dataset {here.dataset}"]
    sections += [f"## {title}\n\n{text}" for title, text in parts.items() if text]
    return "\n\n".join(sections) + "\n"


def kept(run: Run) -> str:
    """Recordings found, kept and left out in ``run``, step by step."""
    if "kept" not in run.tables:
        return ""
    rows = run.tables["kept"].astype(object).fillna("").astype(str).to_numpy().tolist()
    return table(["step", "recording", "found", "kept", "left out"], rows)


def counts(run: Run) -> str:
    """Totals of what was not solved, lost, clipped or repaired in ``run``, where not zero."""
    rows = []
    if "recording_quality" in run.tables:
        counted = run.tables["recording_quality"].dropna(subset="total")
        for instrument, quantities in counted[counted["total"] > 0].groupby("instrument"):
            texts = zip(quantities["quantity"], quantities["total"], strict=True)
            rows.append([instrument, ", ".join(_count(name, total) for name, total in texts)])
    for stem, values in run.metrics.items():
        lost = [
            _count(name, value)
            for name, value in values.items()
            if value and LOST.search(name) and float(value).is_integer()
        ]
        if lost and stem != "recordings":
            rows.append([stem.replace("_", " of ", 1), ", ".join(lost)])
    text = "Totals over all takes that were lost, clipped or repaired; all others were zero."
    return f"{text}\n\n{table(['', 'counted'], rows)}" if rows else ""


def _count(name: str, value: float) -> str:
    return f"{name.replace('_', ' ')} {number(value)}"


def figures(
    captions: Mapping[str, Mapping], items: Sequence[Item], sources: Mapping[str, Sequence[Source]]
) -> str:
    """The figures of ``captions`` (``captions.json``), a sentence each: those of the paper in its
    order, then ours; ``sources`` of :func:`pipeline.verdicts.equations.citations` tell them apart.
    """
    drawn = {
        source.file.as_posix(): item.title
        for item in items
        if item.kind == "figure"
        for source in sources[item.cited_as]
    }
    order = list(drawn)
    scripts = {name: caption["script"] for name, caption in captions.items()}
    ordered = sorted(
        captions,
        key=lambda name: order.index(scripts[name]) if scripts[name] in drawn else len(order),
    )
    lines = []
    for name in ordered:
        place = drawn.get(scripts[name], "Not in the paper")
        lines.append(f"- **{place}.** {short(captions[name]['caption'])}")
        lines.append(f"  ![{captions[name]['title']}](figures/{name}.png)")
    return "\n".join(lines)


def short(caption: str) -> str:
    """The first sentence of a caption, and the one that says what to look at."""
    sentences = re.split(r"(?<=[.!?]) (?=[A-Z(])", caption)
    return " ".join(
        [sentences[0], *(text for text in sentences[1:] if text.startswith("To look at"))]
    )


def gravest_errata(errata: Sequence[Erratum]) -> str:
    """The titles of the errata of GRAVEST as links, and how many there are in all."""
    titles = {erratum.id: erratum.title for erratum in errata}
    lines = [f"- [{titles[name]}](errata.md#{name})" for name in GRAVEST if name in titles]
    return "\n".join([*lines, f"\nAll {len(errata)}: [errata.md](errata.md)."])
