"""Report, pages of all datasets and of the recordings, and results in the README."""

import re
from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from pipeline.core.errors import ContractError
from pipeline.verdicts import decision as d
from pipeline.verdicts import scores
from pipeline.verdicts.claims import CONSTRUCTION, PROJECT, Claim
from pipeline.verdicts.decision import Decided, Verdict
from pipeline.verdicts.estimates import estimates, published_and_ours
from pipeline.verdicts.paper import Erratum, Item, Source
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import TEXTS, number, page, table

TEXT = TEXTS["report"]
ROBOTS: dict[str, str] = TEXT["robots"]
SMOKE = "smoke"  # the scale of a trial run, whose numbers decide nothing
MARKS: dict[str, str] = TEXT["marks"]
WIDTHS = "joint_std"  # figure whose caption names the joints that the models miss
FIGURE = re.compile(r"Fig\. (\w+)")  # label of the figure that shows a claim
COMPARE = "Compare"  # first word of the caption's sentence that the report prints
UNKNOWN = "no evidence"  # value in the table ``readings``
# name in summary.json → model and name of its estimate
SUMMARY = {"sigma_b": ("wishart", "sigma_b"), "noise_level": ("gaussian", "noise_level")}
# names of counts of losses
LOST = re.compile(r"lost|clipped|without|outside|_on_the_bound|end_of_its_interval")
BLOCK = re.compile(r"(?<=<!-- results -->\n).*?(?=<!-- /results -->)", re.DOTALL)


def report_page(
    here: Run, runs: Sequence[Run], decided: Sequence[Decided], parts: Mapping[str, str]
) -> str:
    """Return ``report.md`` of ``here`` with the sections ``parts``, of which ``Figures`` is first;
    no verdicts if smoke.
    """
    own = {**parts, "More": TEXT["links"]}
    if here.scale == SMOKE:
        return page([TEXT["trial"].format(here.dataset)], own)
    head = [f"# Results: dataset {here.dataset}, scale {here.scale}", TEXT["limits"]]
    counts = TEXT["counts"].format(_counts(here, decided).replace(" / ", "/"))
    head += [" ".join([counts, *_synthetic_rules(here, decided), *scores.result(here)])]
    head += [" ".join([*estimates(here, decided), *speeds(here)])]
    predictors = filter(None, [scores.spread_note(here), scores.predictors(here)])
    sections = {
        "Figures of the paper": own.pop("Figures", ""),
        "Published against ours": published_and_ours(here, decided),
        "Predictors": "\n\n".join(predictors),
        "Filters": scores.filters(here),
        "Claims that fail": failures(here, decided),
        "Readings of LU or QR": readings([r for r in runs if r is here or r.dataset in ROBOTS]),
    }
    return page(head, sections | own)


def readme_with_results(text: str, here: Run, decided: Sequence[Decided]) -> str:
    """Return the README's ``text`` with the results between its marks, or raise ContractError."""
    if not BLOCK.search(text):
        message = "the lines <!-- results --> and <!-- /results --> are missing; put them back"
        raise ContractError(message, file="README.md")
    lines = [TEXT["readme"].format(name=here.dataset, counts=_counts(here, decided))]
    lines += [*estimates(here, decided), *scores.result(here)[:2]]
    return BLOCK.sub(lambda _: "\n".join([*lines, ""]), text)


def speeds(here: Run) -> list[str]:
    """Return a sentence on the speeds of the true joint angles, if they are known."""
    known = here.metrics.get("recordings", {})
    reached = {joint: known.get(f"true_{joint}_greatest_speed_rad_per_s") for joint in here.joints}
    if None in reached.values() or not reached:
        return []
    fastest = max(reached, key=reached.get)
    limit = known[f"true_{fastest}_speed_limit_rad_per_s"]
    numbers = {"reached": number(reached[fastest], 3), "limit": number(limit, 3)}
    numbers["beyond"] = f"{known['true_moving_steps_beyond_a_speed_limit_share']:.1%}"
    numbers["backwards"] = f"{known[f'true_{fastest}_fast_steps_backwards_share']:.1%}"
    return [TEXT["speeds"].format(joint=fastest, **numbers)]


def count_claims(verdicts: Sequence[Verdict]) -> tuple[int, int]:
    """Return the numbers of the paper's claims that hold and that fail."""
    verdict = [each.verdict for each in verdicts if each.claim.source != PROJECT]
    return verdict.count(d.REPRODUCED), verdict.count(d.NOT_REPRODUCED)


def _counts(here: Run, decided: Sequence[Decided]) -> str:
    columns = _columns(here, decided)
    counts = ("{} / {}".format(*count_claims(whose.verdicts)) for whose in columns)
    return "; ".join(f"{_robot(w)}: {count}" for w, count in zip(columns, counts, strict=True))


def summary_numbers(here: Run, decided: Sequence[Decided]) -> dict[str, float]:
    """Return at most seven numbers that compare experiments: claims, σ̂_B, L, log scores."""
    numbers = {}
    if here.scale != SMOKE:
        own = next(whose for whose in decided if whose.dataset == here.dataset)
        numbers |= zip(("hold", "fail"), count_claims(own.verdicts), strict=True)
    for name, (model, key) in SUMMARY.items():
        if key in here.metrics.get(f"fit_{model}", {}):
            numbers[name] = here.metrics[f"fit_{model}"][key]
    means = scores.log_scores(here)["mean"] if "predictions" in here.tables else {}
    return numbers | {f"log_{name}": means[name] for name in [*here.models][:3] if name in means}


def _columns(here: Run, decided: Sequence[Decided]) -> list[Decided]:
    """Return the verdicts without a recording, then on ``here``, then on the other robots."""
    by_name = {whose.dataset: whose for whose in decided}
    names = dict.fromkeys([d.WITHOUT_RECORDING, here.dataset, *ROBOTS])
    return [by_name[name] for name in names if name in by_name]


def _robot(whose: Decided) -> str:
    return ROBOTS.get(whose.dataset, whose.dataset)


def _rows(columns: Sequence[Decided]) -> Iterator[tuple[Verdict, ...]]:
    return zip(*(whose.verdicts for whose in columns), strict=True)


def _synthetic_rules(here: Run, decided: Sequence[Decided]) -> list[str]:
    """Return a sentence on the rules of claims that synthetic recordings cannot decide."""
    own = next(whose for whose in decided if whose.dataset == here.dataset)
    words = [v.verdict for v in own.verdicts if v.claim.source != PROJECT]
    passing, failing = words.count(d.SYNTHETIC_PASSES), words.count(d.SYNTHETIC_FAILS)
    if not passing + failing:
        return []
    return [TEXT["undecided"].format(passing + failing, passing, failing)]


def claim_lines(here: Run, decided: Sequence[Decided], label: str | None) -> tuple[list[str], ...]:
    """Return a line for each claim on the figure ``label``, or without a figure, with its verdicts,
    the paper's claims first; and the statements of the claims without evidence.
    """
    columns, lines, without = _columns(here, decided), [], []
    for row in sorted(_rows(columns), key=lambda row: row[0].claim.source == PROJECT):
        claim = row[0].claim
        if (FIGURE.findall(claim.where)[:1] or [None]) != [label]:
            continue
        robots = [_robot(whose).partition(",")[0] for whose in columns]
        cells = zip(robots, map(verdict_cell, row), strict=True)
        shown = " · ".join(f"{robot} {cell}" for robot, cell in cells if cell)
        if shown and claim.by == CONSTRUCTION:
            lines.append(f"- {statement(claim)}")
        elif shown:
            lines.append(f"- {statement(claim)}<br>**{shown}**")
        else:
            without.append(statement(claim))
    return lines, without


def statement(claim: Claim) -> str:
    """Return the statement of ``claim`` with notes on its source and on the reason of a verdict."""
    notes = [TEXT["by"][claim.by]] if claim.by else []
    notes += ["the project's own claim"] if claim.source == PROJECT else []
    notes += ["the paper's own arm"] if claim.about == "specimen" else []
    return f"{claim.statement} *({'; '.join(notes)})*" if notes else claim.statement


def verdict_cell(verdict: Verdict) -> str:
    """Return a verdict's words with the value of its case or the number of cases that hold; "" if
    there is no evidence.
    """
    decided = [case for case in verdict.cases if case.holds is not None]
    if verdict.verdict in (d.NO_RECORDING, d.NO_EVIDENCE):
        return ""
    if verdict.verdict == d.FORCED or not decided:
        return MARKS[d.FORCED]
    mark = MARKS.get(verdict.verdict, verdict.verdict)
    if len(verdict.cases) == 1:
        return f"{mark} {number(decided[0].value)}"
    return f"{mark} {sum(case.holds for case in decided)} of {len(verdict.cases)}"


def failures(here: Run, decided: Sequence[Decided]) -> str:
    """Return a line for each claim that fails: quantity, first failing case, reason."""
    lines, columns = [], _columns(here, decided)
    for row in _rows(columns):
        for whose, (claim, verdict, cases) in zip(columns, row, strict=True):
            if verdict != d.NOT_REPRODUCED:
                continue
            first, *others = [case for case in cases if case.holds is False]
            text = d.case_text(first).removesuffix(" ✗")
            text += f" and {len(others)} more cases" * bool(others)
            reason = f" Reason: {claim.why[whose.dataset]}." if whose.dataset in claim.why else ""
            lines.append(f"- **{claim.id}** on {whose.dataset}: {claim.quantity}, {text}.{reason}")
    return "\n".join(lines)


def readings(runs: Sequence[Run]) -> str:
    """Return by run the claims whose verdict depends on the reading of "LU or QR" (Eq. LUDecom)."""
    rows, notes = [], []
    for run in (run for run in runs if len(run.tables.get("readings", ()))):
        own = run.tables["readings"]
        ruled = own.pivot(index="claim", columns="reading", values="holds")
        ruled = ruled[own["reading"].unique()]  # the run's own first
        first = ruled.iloc[:, 0]
        changes = (ruled.ne(first, axis=0) & ruled.ne(UNKNOWN)).any(axis=1) & first.ne(UNKNOWN)
        for claim, words in ruled[changes].iterrows():
            signs = words.map(TEXT["signs"])
            signs.iloc[0] = f"**{signs.iloc[0]}**"
            rows.append({"claim": claim, "dataset": run.dataset, **signs})
        lacking = own[own["holds"].eq(UNKNOWN) & own["refused"].astype(object).fillna("").ne("")]
        for reading, claims in lacking.groupby("reading", sort=False)["refused"]:
            why = re.split(r" \[|;", claims.iloc[0])[0]
            notes.append(f"- {run.dataset}, {reading}: {len(claims)} claims lack numbers ({why}).")
    if not rows:
        return TEXT["default"]
    changed = pd.DataFrame(rows).fillna("")
    header = ["claim (the run's own reading in bold)", *changed.columns[1:]]
    parts = [f"{TEXT['default']} {TEXT['again']}", table(header, changed.to_numpy())]
    return "\n\n".join([*parts, *["\n".join(notes)] * bool(notes)])


def figures(
    here: Run,
    decided: Sequence[Decided],
    captions: Mapping[str, Mapping],
    items: Sequence[Item],
    sources: Mapping[str, Sequence[Source]],
) -> str:
    """Return the paper's figures in order, each with one sentence of the caption (the COMPARE
    sentence, else the first) and the verdicts on the claims that it shows; then the claims without
    a figure, and links to other figures. ``sources`` name an item's figures.
    """
    ours, sections, absent, unseen = dict(captions), [], [], []
    for item in (item for item in items if item.kind == "figure"):
        if item.without_code:
            absent.append(f"{item.title}: {item.without_code}.")
        lines, without = claim_lines(here, decided, item.label)
        unseen += without
        for name in (source.name.rpartition(".")[2] for source in sources[item.cited_as]):
            if caption := ours.pop(name, None):
                sentences = re.split(r"(?<=[.!?]) (?=[A-Z(])", caption["caption"])
                look = next((s for s in sentences if s.startswith(COMPARE)), sentences[0])
                look = " ".join([look, *scores.widths(here)] if name == WIDTHS else [look])
                image = f"![{caption['title']}](figures/{name}.png)"
                sections.append("\n".join([f"### {item.title}", image, look, *lines]))
                lines = []
        unseen += [line.removeprefix("- ").partition("<br>")[0] for line in lines]
    lines, without = claim_lines(here, decided, None)
    sections += ["\n".join(["### Without a figure", *lines])] if lines else []
    if unseen := unseen + without:
        sections.append(TEXT["unseen"].format(len(unseen), " ".join(unseen)))
    links = "; ".join(f"[{own['title']}](figures/{name}.png)" for name, own in ours.items())
    sections += [f"Figures that are not in the paper: {links}."] if links else []
    return "\n\n".join(filter(None, [" ".join([TEXT["key"], *absent]), *sections]))


def gravest_errata(errata: Sequence[Erratum]) -> str:
    """Return the titles of the gravest errata as links, and the number of all errata."""
    titles = {erratum.id: erratum.title for erratum in errata}
    links = [f"[{titles[name]}](errata.md#{name})" for name in TEXT["gravest"] if name in titles]
    return f"{'; '.join(links)}. All {len(errata)}: [errata.md](errata.md)."


def datasets_page(decided: Sequence[Decided]) -> str:
    """Return ``reports/datasets.md``, with the sign of every verdict by claim and dataset."""
    decided = sorted(decided, key=lambda whose: (whose.recordings == "none", whose.dataset))
    rows = [[row[0].claim.id, *map(verdict_cell, row)] for row in _rows(decided)]
    tally = []
    for name, whose, own in decided:
        forced = sum(verdict.verdict == d.FORCED for verdict in own)
        tally.append([name, TEXTS["whose"][whose], "{} / {}".format(*count_claims(own)), forced])
    head = ["# Every claim in every dataset", TEXTS["datasets"]]
    head.append(table(["dataset", "recordings", "hold / fail", "by construction"], tally))
    return page([*head, table(["claim", *(w.dataset for w in decided)], rows)])


def recordings_page(run: Run) -> str:
    """Return ``recordings.md``, with recordings kept and left out, and nonzero totals of losses."""
    sections, rows = {}, []
    if "kept" in run.tables:
        kept = run.tables["kept"].astype(object).fillna("").astype(str).to_numpy()
        header = ["step", "recording", "found", "kept", "left out"]
        sections["Kept and left out"] = table(header, kept)
    if "recording_quality" in run.tables:
        lossy = run.tables["recording_quality"].query("total > 0").set_index("quantity")
        rows += [[name, _totals(own["total"])] for name, own in lossy.groupby("instrument")]
    for stem, values in run.metrics.items():
        lost = {n: v for n, v in values.items() if v and LOST.search(n) and float(v).is_integer()}
        if lost and stem != "recordings":
            rows.append([stem.replace("_", " of ", 1), _totals(lost)])
    if rows:
        sections["Lost and repaired"] = f"{TEXTS['recordings']}\n\n{table(['', 'counted'], rows)}"
    return page([f"# Recordings of dataset {run.dataset}"], sections)


def _totals(totals: Mapping[str, float]) -> str:
    return ", ".join(f"{n.replace('_', ' ')} {number(total)}" for n, total in totals.items())
