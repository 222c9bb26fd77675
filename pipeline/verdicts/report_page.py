"""Report, pages of all datasets and of the recordings, and results in the README."""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd

from pipeline.core.errors import ContractError
from pipeline.core.options.dataset import UNSEEN
from pipeline.verdicts import decision as d
from pipeline.verdicts import scores, wording
from pipeline.verdicts.claims import PROJECT, Claim
from pipeline.verdicts.decision import Decided, Verdict
from pipeline.verdicts.model_card import few_takes
from pipeline.verdicts.paper import Erratum, Item, Source, noise_levels
from pipeline.verdicts.rules import LEVEL
from pipeline.verdicts.run import Run, index_evidence
from pipeline.verdicts.wording import (
    MISSING,
    WORDS,
    interval,
    number,
    render,
    say,
    table,
)

ROBOTS: dict[str, str] = WORDS["robots"]
SMOKE = "smoke"  # the scale of a trial run, whose numbers decide nothing
WIDTHS = "joint_std"  # figure whose caption names the joints that the models miss
FIGURE = re.compile(r"Fig\. (\w+)|$")  # label of the figure that shows a claim
COMPARE = "Compare"  # first word of the caption's sentence that the report prints
UNKNOWN = "no evidence"  # value in the table ``readings``
# name in summary.json → model and name of its estimate
SUMMARY = {
    "sigma_b": ("wishart", "sigma_b"),
    "noise_level": ("gaussian", "noise_level"),
}
# names of counts of losses
LOST = re.compile(r"lost|clipped|without|outside|_on_the_bound|end_of_its_interval")
BLOCK = re.compile(r"(?<=<!-- results -->\n).*?(?=<!-- /results -->)", re.DOTALL)


def with_plain_names(run: Run) -> Run:
    """Return ``run`` for its pages: Markdown shows all names and texts from files as they are."""
    plain, numbers, tables = (
        wording.escape_markup,
        run.metrics.items(),
        run.tables.items(),
    )
    metrics = {
        stem: dict(zip(map(plain, own), own.values(), strict=True))
        for stem, own in numbers
    }
    tables = {stem: rows.map(plain) for stem, rows in tables}
    return replace(
        run, joints=[*map(plain, run.joints)], metrics=metrics, tables=tables
    )


def with_plain_cases(decided: Decided) -> Decided:
    """Return ``decided`` with the names of its cases as :func:`with_plain_names` has them."""
    plain = wording.escape_markup
    verdicts = [
        each._replace(
            cases=tuple(case._replace(case=plain(case.case)) for case in each.cases)
        )
        for each in decided.verdicts
    ]
    return decided._replace(verdicts=verdicts)


def report_page(
    here: Run,
    runs: Sequence[Run],
    decided: Sequence[Decided],
    captions: Mapping[str, Mapping],
    items: Sequence[Item],
    sources: Mapping[str, Sequence[Source]],
    errata: Sequence[Erratum],
) -> str:
    """Return ``report.md`` of ``here``; no verdicts if smoke. ``captions`` are of the figures by
    name, ``sources`` of :func:`pipeline.verdicts.paper.citations`.
    """
    columns = _columns(here, decided)
    words = _own(here, decided).words
    parts = figures(here, columns, captions, items, sources)
    parts |= {
        "trial": here.scale == SMOKE,
        "counts": _counts(columns),
        "errata": errata,
    }
    undecided = [
        words.count(verdict) for verdict in (d.SYNTHETIC_PASSES, d.SYNTHETIC_FAILS)
    ]
    parts |= {
        "undecided": undecided if any(undecided) else [],
        "result": scores.result(here),
    }
    parts |= {"estimates": estimates(here, decided), "speeds": speeds(here)}
    parts |= {"note": scores.spread_note(here), "predictors": scores.predictors(here)}
    parts["filter_verdict"] = scores.filter_verdict(here)
    parts["filters"] = parts["filter_verdict"] and scores.filters(here)
    parts |= {
        "published": published_and_ours(here, decided),
        "failures": failures(columns),
    }
    parts["readings"] = readings(
        [run for run in runs if run is here or run.dataset in ROBOTS]
    )
    by_id = {erratum.id: erratum for erratum in errata}
    parts["gravest"] = [by_id[name] for name in WORDS["gravest"] if name in by_id]
    return render("report.md", here=here, **parts)


def readme_with_results(text: str, here: Run, decided: Sequence[Decided]) -> str:
    """Return the README's ``text`` with the results between its marks, or raise ContractError."""
    if not BLOCK.search(text):
        message = "the lines <!-- results --> and <!-- /results --> are missing; put them back"
        raise ContractError(message, file="README.md")
    lines = [say("readme", here=here, counts=_counts(_columns(here, decided)))]
    lines += [*filter(None, [estimates(here, decided)]), *scores.result(here)[:2]]
    return BLOCK.sub(lambda _: "\n".join([*lines, ""]), text)


def speeds(here: Run) -> str:
    """Return a sentence on the speeds of the true joint angles, "" if they are not known."""
    known = here.metrics.get("recordings", {})
    reached = {
        joint: known.get(f"true_{joint}_greatest_speed_rad_per_s")
        for joint in here.joints
    }
    if None in reached.values() or not reached:
        return ""
    joint = max(reached, key=reached.get)
    return say("speeds", joint=joint, known=known)


def _counts(columns: Sequence[Decided]) -> str:
    return "; ".join(
        f"{_robot(whose)}: {' / '.join(map(str, whose.counts))}" for whose in columns
    )


def summary_numbers(here: Run, decided: Sequence[Decided]) -> dict[str, float]:
    """Return at most seven numbers that compare experiments: claims, σ̂_B, L, log scores."""
    numbers = {}
    if here.scale != SMOKE:
        numbers |= zip(("hold", "fail"), _own(here, decided).counts, strict=True)
    for name, (model, key) in SUMMARY.items():
        if key in here.metrics.get(f"fit_{model}", {}):
            numbers[name] = here.metrics[f"fit_{model}"][key]
    means = scores.log_scores(here)["mean"] if "predictions" in here.tables else {}
    return numbers | {
        f"log_{name}": means[name] for name in [*here.models][:3] if name in means
    }


def _own(here: Run, decided: Sequence[Decided]) -> Decided:
    return next(whose for whose in decided if whose.dataset == here.dataset)


def _columns(here: Run, decided: Sequence[Decided]) -> list[Decided]:
    """Return the verdicts without a recording, then on ``here``, then on the other robots."""
    by_name = {whose.dataset: whose for whose in decided}
    names = dict.fromkeys([d.WITHOUT_RECORDING, here.dataset, *ROBOTS])
    return [by_name[name] for name in names if name in by_name]


def _robot(whose: Decided) -> str:
    return ROBOTS.get(whose.dataset, whose.dataset)


def verdict_cell(verdict: Verdict) -> str:
    """Return a verdict's words with the value of its case or the number of cases that hold; "" if
    there is no evidence.
    """
    held = [case for case in verdict.cases if case.holds is not None]
    if verdict.verdict in (d.NO_RECORDING, d.NO_EVIDENCE):
        return ""
    if verdict.verdict == d.FORCED or not held:
        return WORDS["marks"][d.FORCED]
    mark = WORDS["marks"].get(verdict.verdict, verdict.verdict)
    if len(verdict.cases) == 1:
        return f"{mark} {number(held[0].value)}"
    return f"{mark} {sum(case.holds for case in held)} of {len(verdict.cases)}"


def failures(columns: Sequence[Decided]) -> list[str]:
    """Return a line for each claim that fails: quantity, first failing case, reason."""
    lines = []
    for row in zip(*(whose.verdicts for whose in columns), strict=True):
        for whose, (claim, verdict, cases) in zip(columns, row, strict=True):
            if verdict == d.NOT_REPRODUCED:
                failing = [d.case_text(case) for case in cases if case.holds is False]
                lines.append(
                    say("failure", claim=claim, dataset=whose.dataset, failing=failing)
                )
    return lines


def readings(runs: Sequence[Run]) -> str:
    """Return by run the claims whose verdict depends on the reading of "LU or QR" (Eq. LUDecom)."""
    rows, notes = [], []
    for run in (run for run in runs if len(run.tables.get("readings", ()))):
        own = run.tables["readings"]
        ruled = own.pivot(index="claim", columns="reading", values="holds")
        ruled = ruled[own["reading"].unique()]  # the run's own first
        first = ruled.iloc[:, 0]
        changes = (ruled.ne(first, axis=0) & ruled.ne(UNKNOWN)).any(axis=1) & first.ne(
            UNKNOWN
        )
        for claim, words in ruled[changes].iterrows():
            signs = words.map(WORDS["signs"])
            signs.iloc[0] = f"**{signs.iloc[0]}**"
            rows.append({"claim": claim, "dataset": run.dataset, **signs})
        lacking = own[
            own["holds"].eq(UNKNOWN) & own["refused"].astype(object).fillna("").ne("")
        ]
        for reading, claims in lacking.groupby("reading", sort=False)["refused"]:
            why = re.split(r" \[|;", claims.iloc[0])[0]
            notes.append(
                f"- {run.dataset}, {reading}: {len(claims)} claims lack numbers ({why})."
            )
    if not rows:
        return say("default")
    changed = pd.DataFrame(rows).fillna("")
    header = ["claim (the run's own reading in bold)", *changed.columns[1:]]
    rows = table(header, changed.to_numpy())
    return "\n\n".join(
        [f"{say('default')} {say('again')}", rows, "\n".join(notes)]
    ).rstrip()


def figures(
    here: Run,
    columns: Sequence[Decided],
    captions: Mapping[str, Mapping],
    items: Sequence[Item],
    sources: Mapping[str, Sequence[Source]],
) -> dict[str, object]:
    """Return the paper's ``figures`` in order: ``item``, ``drawn`` figures with ``title`` and one
    sentence of the caption as ``look`` (the COMPARE sentence, else the first), and ``lines``, the
    claims that it shows with their verdicts, the paper's first; lines of ``unplaced`` claims;
    claims that are ``unseen``, without evidence or figure; ``further`` captions.
    """
    lines: dict[str, list[tuple[Claim, str]]] = defaultdict(list)
    without: dict[str, list[Claim]] = defaultdict(list)
    rows = zip(*(whose.verdicts for whose in columns), strict=True)
    for row in sorted(rows, key=lambda row: row[0].claim.source == PROJECT):
        claim, robots = (
            row[0].claim,
            [_robot(whose).partition(",")[0] for whose in columns],
        )
        cells = zip(robots, map(verdict_cell, row), strict=True)
        shown = " · ".join(f"{robot} {cell}" for robot, cell in cells if cell)
        label = FIGURE.search(claim.where)[1]
        if shown:
            lines[label].append((claim, shown))
        else:
            without[label].append(claim)
    further, found, unseen = dict(captions), [], []
    for item in (item for item in items if item.kind == "figure"):
        drawn = []
        for name in (
            source.name.rpartition(".")[2] for source in sources[item.cited_as]
        ):
            if caption := further.pop(name, None):
                sentences = re.split(r"(?<=[.!?]) (?=[A-Z(])", caption["caption"])
                look = next(
                    (s for s in sentences if s.startswith(COMPARE)), sentences[0]
                )
                look = " ".join(
                    [look, *(scores.widths(here) if name == WIDTHS else ())]
                )
                drawn.append((name, {"title": caption["title"], "look": look}))
        unseen += without[item.label]
        unseen += [] if drawn else [claim for claim, _ in lines[item.label]]
        found.append({"item": item, "drawn": drawn, "lines": lines[item.label]})
    known = {
        "unplaced": lines[None],
        "unseen": unseen + without[None],
        "further": further,
    }
    return {"figures": found, **known}


def estimates(here: Run, decided: Sequence[Decided]) -> str:
    """Return a sentence on σ̂_B by each estimator beside the published value, if it was fitted."""
    fitted, few = here.metrics.get("fit_wishart", {}), few_takes(here)
    cells = [
        f"{_estimate(fitted, 'sigma_b', estimator, few)} by {name}"
        for estimator, name in WORDS["estimators"].items()
        if f"sigma_b_{estimator}" in fitted
    ]
    published = [
        v.claim.published for v in decided[0].verdicts if v.claim.id == "sigma-b"
    ]
    return (
        say("dispersion", run=here, cells=cells, published=published[0])
        if cells
        else ""
    )


def published_and_ours(here: Run, decided: Sequence[Decided]) -> str:
    """Return the fitted parameters by estimator, then the other published numbers and ours."""
    few, without, estimators = few_takes(here), decided[-1], WORDS["estimators"]
    own = _own(here, decided)
    published = {verdict.claim.id: verdict.claim.published for verdict in own.verdicts}
    rows, others = [], []
    for name, (file, key, claim) in WORDS["parameters"].items():
        fitted = here.metrics.get(file, {})
        cells = [_estimate(fitted, key, estimator, few) for estimator in estimators]
        if {*cells} != {MISSING}:
            rows.append([name, published.get(claim, MISSING), *cells])
    fitted = here.metrics.get("fit_gaussian", {}) if here.arm.numbered else {}
    if levels := noise_levels(fitted, published):
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
            ends = [
                "" if few or c.low is None else " " + interval(c.low, c.high)
                for c in cases
            ]
            ours = [
                number(case.value) + end for case, end in zip(cases, ends, strict=True)
            ]
            others.append([name, printed, " / ".join(ours) + _errors(here, claim)])
    parts = [say("published", few=few, levels=levels)]
    parts += (
        [table(["parameter", "published", *estimators.values()], rows)] if rows else []
    )
    parts += [table(["number", "published", here.dataset], others)] if others else []
    return "\n\n".join(parts)


def _errors(here: Run, claim: Claim) -> str:
    """Return the greatest of each of the errors that add in squares, if there are several."""
    rows, errors = index_evidence(here.evidence), []
    for error in claim.standard_error if len(claim.standard_error) > 1 else ():
        found = [error.look_up(rows, case) for case in claim.cases(here.arm)]
        errors.append(number(max(filter(None, found), default=float("nan")), 3))
    words = " (standard errors up to: sampling {}, which decides, and quadrature {})"
    return words.format(*errors) if errors else ""


def _estimate(fitted: Mapping[str, float], key: str, estimator: str, few: bool) -> str:
    """Return an estimate with its interval, or "unbounded" at the end of the searched interval; the
    mean of a Wishart step ends at σ_B = 1 for every number of joints, its covariance before.
    """
    name = f"{key}_{estimator}"
    if fitted.get(f"{name}_unbounded"):
        return "unbounded"
    if name not in fitted:
        return MISSING
    ends = [fitted.get(f"{name}_interval_{end}") for end in ("low", "high")]
    text = number(fitted[name])
    text = text if few or None in ends else f"{text} {interval(*ends)}"
    limit = fitted.get("sigma_b_limit_of_the_covariance", float("inf"))
    lacks = "mean" if fitted[name] >= 1 else "covariance"
    return (
        f"{text} (no {lacks})" if "sigma_b" in key and fitted[name] >= limit else text
    )


def datasets_page(decided: Sequence[Decided], unfit: Sequence[str] = ()) -> str:
    """Return ``reports/datasets.md``, with the sign of every verdict by claim and dataset, and the
    sentences ``unfit`` on evidence of other recordings.
    """
    decided = sorted(
        decided, key=lambda whose: (whose.recordings == "none", whose.dataset)
    )
    verdicts = zip(*(whose.verdicts for whose in decided), strict=True)
    rows = [[row[0].claim.id, *map(verdict_cell, row)] for row in verdicts]
    words = {
        "decided": decided,
        "forced": d.FORCED,
        "level": LEVEL,
        "rows": rows,
        "unfit": unfit,
    }
    return render("datasets.md", **words)


def recordings_page(run: Run) -> str:
    """Return ``recordings.md``, with recordings kept and left out, and nonzero totals of losses."""
    kept, totals = run.tables.get("kept", pd.DataFrame()), {}
    if "recording_quality" in run.tables:
        lossy = run.tables["recording_quality"].query("total > 0").set_index("quantity")
        totals |= {name: own["total"] for name, own in lossy.groupby("instrument")}
    for stem, values in run.metrics.items():
        lost = {
            n: v
            for n, v in values.items()
            if v and LOST.search(n) and float(v).is_integer()
        }
        if lost and stem != "recordings":
            totals[stem.replace("_", " of ", 1)] = lost
    lost = [
        (
            name,
            ", ".join(
                f"{n.replace('_', ' ')} {number(total)}" for n, total in own.items()
            ),
        )
        for name, own in totals.items()
    ]
    kept = kept.astype(object).fillna("").astype(str).to_numpy().tolist()
    words = {"run": run, "kept": kept, "lost": lost, "unseen": UNSEEN}
    return render("recordings.md", **words)
