"""Report, pages of all datasets and of the recordings, and results in the README."""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import pandas as pd

from pipeline.core.errors import ContractError
from pipeline.core.options.dataset import UNSEEN
from pipeline.verdicts import scores, wording
from pipeline.verdicts.claims import PROJECT, Claim
from pipeline.verdicts.decision import Decided
from pipeline.verdicts.encoders import (
    undecided_in_run,
    undecided_text,
    within_run,
    within_run_sentences,
)
from pipeline.verdicts.estimates import published_and_ours
from pipeline.verdicts.finding import finding
from pipeline.verdicts.paper import Erratum, Item, Source
from pipeline.verdicts.rules import LEVEL
from pipeline.verdicts.run import Run
from pipeline.verdicts.tally import (
    COUNTED,
    DEPENDS,
    FAILS,
    FORCED,
    OUTCOMES,
    Group,
    Joined,
    Row,
    case_count,
    joined_text,
    joined_verdicts,
    shared_takes,
)
from pipeline.verdicts.wording import WORDS, join_names, render, say, table

# figures whose caption has sentences with numbers of the run
ADDED = {
    "joint_std": scores.widths,
    "wrench_error_histograms": scores.without_random_matrix,
}
FIGURE = re.compile(r"Fig\. (\w+)|$")  # label of the figure that shows a claim
COMPARE = "Compare"  # first word of the caption's sentence that the report prints
SENTENCE_END = re.compile(r"(?<=[.!?]) (?=[A-Z(])")
PICTURE = "takes"  # figure on the page of the recordings
# name in summary.json → model and name of its estimate
SUMMARY = {
    "sigma_b": ("wishart", "sigma_b"),
    "noise_level": ("gaussian", "noise_level"),
}
# names of counts of losses
LOST = re.compile(r"lost|clipped|without|outside|_on_the_bound|end_of_its_interval")
BLOCK = re.compile(r"(?<=<!-- results -->\n).*?(?=<!-- /results -->)", re.DOTALL)


class Drawn(NamedTuple):
    """Figures of the run by name with their captions, the items of the paper, and the code that
    draws each item (:func:`pipeline.verdicts.paper.citations`).
    """

    captions: Mapping[str, Mapping]
    items: Sequence[Item]
    sources: Mapping[str, Sequence[Source]]


class Edition(NamedTuple):
    """Version of the project, and seed of the run's random numbers."""

    version: str
    seed: int


class Figure(NamedTuple):
    """A figure of the paper: ``drawn`` name, title and sentence to look at; ``lines`` of claims."""

    item: Item
    drawn: list[tuple[str, str, str]]
    lines: list[tuple[Claim, str]]


def with_plain_names(run: Run) -> Run:
    """Return ``run`` for its pages: Markdown shows all names and texts from files as they are."""
    plain = wording.escape_markup
    metrics = {}
    tables = {}
    for stem, numbers in run.metrics.items():
        metrics[stem] = {plain(name): value for name, value in numbers.items()}
    for stem, rows in run.tables.items():
        tables[stem] = rows.map(plain)
    joints = [plain(joint) for joint in run.joints]
    return replace(run, joints=joints, metrics=metrics, tables=tables)


def with_plain_cases(decided: Decided) -> Decided:
    """Return ``decided`` with the names of its cases as :func:`with_plain_names` has them."""
    verdicts = []
    for verdict in decided.verdicts:
        cases = [
            case._replace(case=wording.escape_markup(case.case))
            for case in verdict.cases
        ]
        verdicts.append(verdict._replace(cases=tuple(cases)))
    return decided._replace(verdicts=verdicts)


def report_page(
    here: Run,
    groups: Sequence[Group],
    rows: Sequence[Row],
    drawn: Drawn,
    errata: Sequence[Erratum],
    edition: Edition,
) -> str:
    """Return ``report.md`` of ``here`` with the verdicts of all ``groups`` and their tally."""
    lines = claim_lines(groups)
    by_id = {erratum.id: erratum for erratum in errata}
    parts = figures(here, lines, drawn)
    parts |= {
        "finding": finding(groups, rows),
        "tally": tally_table(rows),
        "speeds": speeds(here),
        "published": published_and_ours(here, groups),
        "note": scores.spread_note(here),
        "result": " ".join(scores.result(here)),
        "errata": errata,
        "gravest": [by_id[name] for name in WORDS["gravest"] if name in by_id],
    }
    return render("report.md", here=here, edition=edition, **parts)


def trial_page(here: Run, drawn: Drawn) -> str:
    """Return ``report.md`` of a trial: its figures, and no verdict."""
    parts = figures(here, {}, drawn)
    return render("trial.md", here=here, **parts)


def readme_with_results(text: str, groups: Sequence[Group], rows: Sequence[Row]) -> str:
    """Return the README's ``text`` with the results between its marks, or raise ContractError."""
    if not BLOCK.search(text):
        message = "the lines <!-- results --> and <!-- /results --> are missing; put them back"
        raise ContractError(message, file="README.md")
    block = f"{' '.join(finding(groups, rows))}\n\n{tally_table(rows)}\n"
    return BLOCK.sub(lambda _: block, text)


def tally_table(rows: Sequence[Row]) -> str:
    """Return the count of the paper's claims by group of datasets, and the groups without any."""
    cells = []
    undecided = []
    for row in rows:
        if not any(row.claims[word] for word in COUNTED):
            undecided.append(_row_name(row))
            continue
        counts = {word: str(len(row.claims[word])) for word in COUNTED}
        failing = row.claims[FAILS]
        if failing and row.decides:
            counts[FAILS] += f": {_named(row.group, failing)}"
        cells.append([_row_name(row), *counts.values()])
    text = table(["recordings", *COUNTED], cells)
    if undecided:
        text += f"\n\nNo claim is decided: {join_names(undecided)}."
    return text


def _row_name(row: Row) -> str:
    """Return robot and datasets of a row of the tally."""
    group = row.group
    if not group.runs:
        return "computations without a recording"
    if group.synthetic and not row.decides:
        return f"{group.name}: claims about robots, which it does not decide"
    datasets = [run.dataset for run in group.runs]
    if len(datasets) == 1:
        return f"{group.name} (`{datasets[0]}`)"
    names = ", ".join(f"`{dataset}`" for dataset in datasets)
    sharing = shared_takes(group)
    if sharing == [datasets]:
        return f"{group.name} ({names}, which share takes)"
    notes = [f"; {join_names(sharers)} share takes" for sharers in sharing]
    return f"{group.name} ({names}{''.join(notes)})"


def _named(group: Group, failing: Sequence[Joined]) -> str:
    """Return the ids of ``failing`` claims with the datasets in which they fail, "all" for every
    dataset of several.
    """
    texts = []
    for joined in failing:
        datasets = joined.datasets(FAILS)
        place = ""
        if len(datasets) < len(group.verdicts):
            place = f" ({', '.join(datasets)})"
        elif len(datasets) > 1:
            place = " (all)"
        texts.append(joined.claim.id + place)
    return ", ".join(texts)


def speeds(here: Run) -> str:
    """Return a sentence on true joint angles beyond the robot's speed limits, "" for none and if
    they are not known.
    """
    numbers = here.metrics.get("recordings", {})
    reached = {}
    for joint in here.joints:
        speed = numbers.get(f"true_{joint}_greatest_speed_rad_per_s")
        limit = numbers.get(f"true_{joint}_speed_limit_rad_per_s")
        if speed is not None and limit is not None and speed > limit:
            reached[joint] = speed
    if not reached:
        return ""
    joint = max(reached, key=reached.get)
    return say("speeds", joint=joint, known=numbers)


def summary_numbers(here: Run, rows: Sequence[Row]) -> dict[str, float]:
    """Return at most seven numbers that compare experiments: claims that hold and fail on the
    dataset's group, σ̂_B, L, log scores.
    """
    numbers: dict[str, float] = {}
    for row in rows:
        if here.dataset in row.group.verdicts and row.decides:
            counts = {word: len(claims) for word, claims in row.claims.items()}
            failing = counts[FAILS] + counts[DEPENDS]
            numbers["fail"] = failing
            numbers["hold"] = sum(counts.values()) - failing
    for name, (model, key) in SUMMARY.items():
        fitted = here.metrics.get(f"fit_{model}", {})
        if key in fitted:
            numbers[name] = fitted[key]
    if "predictions" in here.tables:
        means = scores.log_scores(here)["mean"]
        first_models = [*here.models][:3]
        for name in means.index.intersection(first_models, sort=False):
            numbers[f"log_{name}"] = means[name]
    return numbers


def claim_lines(groups: Sequence[Group]) -> dict[str, list[tuple[Claim, str]]]:
    """Return each claim with its verdicts in all ``groups``, "" without evidence, by the label of
    the figure that shows it ("" without one); the paper's first.
    """
    by_group = [joined_verdicts(group) for group in groups]
    ordered = sorted(zip(*by_group, strict=True), key=_is_projects)
    lines: dict[str, list[tuple[Claim, str]]] = defaultdict(list)
    for of_claim in ordered:
        claim = of_claim[0].claim
        cells = []
        for group, verdict in zip(groups, of_claim, strict=True):
            text = joined_text(group, verdict) or undecided_in_run(group, claim)
            if text:
                cells.append(f"{group.robot} {text}")
        label = FIGURE.search(claim.where)[1] or ""
        if claim.by == "construction":
            cells = cells[:1]
        lines[label].append((claim, " · ".join(cells)))
    return lines


def _is_projects(of_claim: Sequence[Joined]) -> bool:
    return of_claim[0].claim.source == PROJECT


def figures(
    here: Run,
    lines: Mapping[str, list[tuple[Claim, str]]],
    drawn: Drawn,
) -> dict[str, object]:
    """Return the ``figures`` of the paper in order with the claims that each shows; ``unplaced``
    claims with evidence and without a figure; ``unseen`` claims, without evidence or without the
    figure; ``further`` captions, of figures that are not in the paper.
    """
    further = dict(drawn.captions)
    shown = []
    unplaced = []
    unseen = []
    for item in (item for item in drawn.items if item.kind == "figure"):
        pictures = []
        for source in drawn.sources[item.cited_as]:
            name = source.name.rpartition(".")[2]
            caption = further.pop(name, None)
            if caption:
                pictures.append((name, caption["title"], _look(here, name, caption)))
        with_verdict = []
        for claim, text in lines.get(item.label, []):
            if pictures and text:
                with_verdict.append((claim, text))
            else:
                unseen.append(claim)
        shown.append(Figure(item, pictures, with_verdict))
    for claim, text in lines.get("", []):
        if text:
            unplaced.append((claim, text))
        else:
            unseen.append(claim)
    return {
        "figures": shown,
        "unplaced": unplaced,
        "unseen": unseen,
        "further": further,
    }


def _look(here: Run, name: str, caption: Mapping[str, str]) -> str:
    """Return the sentence of a caption to look at: the COMPARE sentence, else the first."""
    sentences = SENTENCE_END.split(caption["caption"])
    compare = [text for text in sentences if text.startswith(COMPARE)] or sentences
    added = ADDED[name](here) if name in ADDED else []
    return " ".join([compare[0], *added])


def datasets_page(
    groups: Sequence[Group],
    rows: Sequence[Row],
    unfit: Sequence[str] = (),
) -> str:
    """Return ``reports/datasets.md``: the tally, the claims by cause and arm with a sentence where
    they differ, the verdict of every dataset, and sentences ``unfit`` on evidence of other files.
    """
    datasets = [(group, name) for group in groups for name in group.verdicts]
    claims = [verdict.claim for verdict in next(iter(groups[0].verdicts.values()))]
    every = []
    for place, claim in enumerate(claims):
        cells = [_cell(group, name, place) for group, name in datasets]
        every.append([claim.id, *cells])
    words = {
        "tally": tally_table(rows),
        "arms": _arms_table(groups),
        "header": ["claim", *(name for _, name in datasets)],
        "every": every,
        "within_runs": within_run_sentences(groups),
        "level": LEVEL,
        "unfit": unfit,
    }
    return render("datasets.md", **words)


def _cell(group: Group, dataset: str, place: int) -> str:
    """Return word and number of cases of the claim at ``place`` on one dataset."""
    verdict = group.verdicts[dataset][place]
    word = OUTCOMES.get(verdict.verdict, "")
    if not word and within_run(verdict):
        return undecided_text(verdict)
    if word in ("", FORCED):
        return WORDS["marks"].get(word, "")
    return f"{WORDS['marks'][word]} {case_count(verdict)}"


def _arms_table(groups: Sequence[Group]) -> str:
    """Return the claims by cause and arm, with a sentence where their verdicts differ."""
    rows = []
    words = {}
    by_group = [joined_verdicts(group) for group in groups]
    for of_claim in zip(*by_group, strict=True):
        words = {}
        for group, joined in zip(groups, of_claim, strict=True):
            words |= _words_by_cause(group, joined)
        if {*words.values()} & {*COUNTED}:
            signs = [WORDS["marks"].get(word, "") for word in words.values()]
            sentence = _difference(words, of_claim)
            rows.append([of_claim[0].claim.id, *signs, sentence])
    return table(["claim", *words, "where they differ"], rows)


def _words_by_cause(group: Group, joined: Joined) -> dict[str, str]:
    """Return the word of a claim by robot, of a synthetic robot for each cause of its noise."""
    words = {}
    for cause in dict.fromkeys(group.cause_of.values()) or [""]:
        if cause:
            words[f"{group.robot}: {cause}"] = joined.by_cause.get(cause, "")
        else:
            words[group.robot] = joined.by_cause.get(cause, joined.word)
    return words


def _difference(words: Mapping[str, str], of_claim: Sequence[Joined]) -> str:
    """Return the sentence on a claim that holds in some columns and fails in others, with the
    reasons that the claim states for datasets in which it fails.
    """
    holding = [name for name, word in words.items() if word in COUNTED[:2]]
    failing = [name for name, word in words.items() if word == FAILS]
    if not holding or not failing:
        return ""
    reasons = {}
    for joined in of_claim:
        for dataset in joined.datasets(FAILS):
            if dataset in joined.claim.why:
                reasons[dataset] = joined.claim.why[dataset]
    return say("difference", holding=holding, failing=failing, reasons=reasons)


def recordings_page(run: Run, captions: Mapping[str, Mapping]) -> str:
    """Return ``recordings.md``, with recordings kept and left out, the picture of the takes if it
    has one of the ``captions``, and nonzero totals of losses.
    """
    lost = []
    for name, counts in losses(run).items():
        texts = []
        for quantity, count in counts.items():
            texts.append(f"{quantity.replace('_', ' ')} {wording.number(count)}")
        lost.append((name, ", ".join(texts)))
    kept = run.tables.get("kept", pd.DataFrame()).astype(object).fillna("")
    words = {
        "run": run,
        "kept": kept.astype(str).to_numpy().tolist(),
        "picture": captions.get(PICTURE),
        "lost": lost,
        "unseen": UNSEEN,
    }
    return render("recordings.md", **words)


def losses(run: Run) -> dict[str, Mapping[str, float]]:
    """Return the nonzero totals of losses by instrument, and by stage."""
    totals: dict[str, Mapping[str, float]] = {}
    if "recording_quality" in run.tables:
        lossy = run.tables["recording_quality"].query("total > 0").set_index("quantity")
        for instrument, rows in lossy.groupby("instrument"):
            totals[instrument] = rows["total"]
    for stem, values in run.metrics.items():
        if stem == "recordings":
            continue
        lost = {name: n for name, n in values.items() if _is_loss(name, n)}
        if lost:
            stage = stem.replace("_", " of ", 1)
            totals[stage] = lost
    return totals


def _is_loss(name: str, value: float) -> bool:
    """Return True for a nonzero whole number whose name counts losses."""
    return bool(value) and bool(LOST.search(name)) and float(value).is_integer()
