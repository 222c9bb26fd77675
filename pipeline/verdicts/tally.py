"""One count of the verdicts: every dataset once.

Datasets that share takes are joined, and so are the synthetic datasets of one arm, which differ in
the laboratory's cause of the noise.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pipeline.verdicts import decision as d
from pipeline.verdicts.claims import PAPER, Claim
from pipeline.verdicts.decision import Decided, Verdict
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import WORDS, join_names, number

HOLDS = d.HOLDS
FAILS = d.FAILS
UNKNOWN = d.UNKNOWN
FORCED = d.FORCED
SPEED_LAW = d.WITH_SPEED_LAW
DEPENDS = "depends on the cause"
ROBOTS: dict[str, str] = WORDS["robots"]
# verdict on one dataset → verdict of the count
OUTCOMES = {
    d.REPRODUCED: HOLDS,
    d.SYNTHETIC_PASSES: HOLDS,
    d.WITH_SPEED_LAW: SPEED_LAW,
    d.SYNTHETIC_WITH_SPEED_LAW: SPEED_LAW,
    d.NOT_REPRODUCED: FAILS,
    d.SYNTHETIC_FAILS: FAILS,
    d.FORCED: FORCED,
}
SHORT = {SPEED_LAW: d.SPEED_LAW}  # words in the line of a claim
COUNTED = (HOLDS, SPEED_LAW, FAILS, DEPENDS)  # columns of the tally
# numbers of a claim that a curve follows another → field of a case
FOLLOWS_NUMBERS = {
    "r": "value",
    "limit": "threshold",
    "power": "power",
    "power against the speed law": "speed_power",
}


class Group(NamedTuple):
    """Datasets that share takes, or a synthetic arm under several causes; ``name`` is the robot's.

    ``runs`` are in their order, ``verdicts`` are by dataset; the group without runs has the claims
    that need no recording.
    """

    name: str
    runs: tuple[Run, ...]
    verdicts: Mapping[str, Sequence[Verdict]]

    @property
    def synthetic(self) -> bool:
        """True for recordings of the laboratory."""
        return any(run.synthetic for run in self.runs)

    @property
    def cause_of(self) -> dict[str, str]:
        """Cause of the noise by dataset, of synthetic datasets of the first one's arm; "" if the
        laboratory states none.
        """
        arms = [
            run for run in self.runs if run.synthetic and run.arm == self.runs[0].arm
        ]
        return {run.dataset: run.cause for run in arms}

    @property
    def robot(self) -> str:
        """Short name for the cells of the claims."""
        return self.name.replace(", real", "").replace(",", "")


class Joined(NamedTuple):
    """Verdict of a group on a claim: ``word`` of COUNTED, FORCED or UNKNOWN; ``by_cause`` has the
    word under each cause for the group's first arm, ``by_dataset`` the verdict of each dataset with
    evidence.
    """

    claim: Claim
    word: str
    by_cause: dict[str, str]
    by_dataset: dict[str, Verdict]

    def datasets(self, word: str) -> list[str]:
        """Datasets with the outcome ``word``."""
        return [
            dataset
            for dataset, verdict in self.by_dataset.items()
            if OUTCOMES[verdict.verdict] == word
        ]


class Row(NamedTuple):
    """Row of the tally: ids of claims by word; ``decides`` is False for synthetic recordings of
    claims about robots.
    """

    group: Group
    decides: bool
    claims: dict[str, list[Joined]]


def groups_of(runs: Sequence[Run], decided: Sequence[Decided]) -> list[Group]:
    """Return the group of the claims that need no recording, then the groups of the ``runs``: the
    run's own first, then the robots of ROBOTS in their order.
    """
    verdicts = {column.dataset: column.verdicts for column in decided}
    name = d.WITHOUT_RECORDING
    groups = [Group(name, (), {name: verdicts[name]})]
    components = _components(runs)  # none if the only run is a trial
    further = sorted(components[1:], key=_place)
    for component in [*components[:1], *further]:
        name = robot_name(component)
        by_dataset = {run.dataset: verdicts[run.dataset] for run in component}
        groups.append(Group(name, tuple(component), by_dataset))
    return groups


def _place(runs: Sequence[Run]) -> int:
    """Return the place of the robot of ``runs`` in ROBOTS, the last for another."""
    names = [*ROBOTS.values()]
    name = robot_name(runs)
    return names.index(name) if name in names else len(names)


def robot_name(runs: Sequence[Run]) -> str:
    """Return the name of the robot of ``runs`` on the pages, with "real" or "synthetic"."""
    for run in runs:
        if run.dataset in ROBOTS:
            return ROBOTS[run.dataset]
    kind = "synthetic" if runs[0].synthetic else "real"
    return f"{runs[0].dataset}, {kind}"


def _components(runs: Sequence[Run]) -> list[list[Run]]:
    """Return the ``runs`` in groups of those joined by :func:`joined`, also over others."""
    groups: list[list[Run]] = []
    for run in runs:
        apart = []
        merged = []
        for group in groups:
            if any(joined(run, seen) for seen in group):
                merged += group
            else:
                apart.append(group)
        groups = [*apart, [*merged, run]]
        groups.sort(key=lambda group: runs.index(group[0]))
    return groups


def joined(run: Run, second: Run) -> bool:
    """Return True for two runs that share takes, or that differ only in the cause of the noise."""
    if {*run.raw_hashes} & {*second.raw_hashes}:
        return True
    both_synthetic = run.cause != "" and second.cause != ""
    return both_synthetic and run.arm == second.arm


def joined_verdicts(group: Group) -> list[Joined]:
    """Return the verdict of a ``group`` on every claim."""
    verdicts = []
    for of_claim in zip(*group.verdicts.values(), strict=True):
        by_dataset = dict(zip(group.verdicts, of_claim, strict=True))
        verdicts.append(_joined_verdict(group, by_dataset))
    return verdicts


def _joined_verdict(group: Group, by_dataset: Mapping[str, Verdict]) -> Joined:
    """Return the verdict of a ``group`` on one claim: over causes for the first arm, then over the
    arms that share its takes.
    """
    evident = {}
    by_cause = {}
    without_cause = []
    for dataset, verdict in by_dataset.items():
        word = OUTCOMES.get(verdict.verdict)
        if word is None:
            continue
        evident[dataset] = verdict
        if dataset in group.cause_of:
            by_cause[group.cause_of[dataset]] = word
        else:
            without_cause.append(word)
    over_causes = _of_causes([*by_cause.values()])
    word = _of_datasets([over_causes, *without_cause])
    claim = next(iter(by_dataset.values())).claim
    return Joined(claim, word, by_cause, evident)


def _of_datasets(words: Sequence[str]) -> str:
    """Return the word of several datasets: one that fails makes the claim fail. If the claim
    depends on the cause, it still does: a further dataset has only one of the causes.
    """
    for word in (DEPENDS, FAILS, FORCED, SPEED_LAW, HOLDS):
        if word in words:
            return word
    return UNKNOWN


def _of_causes(words: Sequence[str]) -> str:
    """Return the word of several causes: DEPENDS if the claim fails under some causes only."""
    if FAILS in words and {*words} != {FAILS}:
        return DEPENDS
    return _of_datasets(words)


def tally(groups: Sequence[Group]) -> list[Row]:
    """Return the count of the paper's claims: two rows for a synthetic arm, since its recordings do
    not decide claims about robots.
    """
    rows = []
    for group in groups:
        papers = [v for v in joined_verdicts(group) if v.claim.source == PAPER]
        counted = [verdict for verdict in papers if verdict.word in COUNTED]
        for deciding in (True, False):
            chosen = [v for v in counted if decides(group, v.claim) == deciding]
            if chosen or (deciding and group.runs):
                by_word = {
                    word: [verdict for verdict in chosen if verdict.word == word]
                    for word in COUNTED
                }
                rows.append(Row(group, deciding, by_word))
    return rows


def decides(group: Group, claim: Claim) -> bool:
    """Return False for synthetic recordings and a claim about robots."""
    return not group.synthetic or claim.about == "method"


def shared_takes(group: Group) -> list[list[str]]:
    """Return the datasets of a ``group`` that have the same takes, each set of several."""
    by_files: dict[tuple[str, ...], list[str]] = {}
    for run in group.runs:
        by_files.setdefault(tuple(run.raw_hashes), []).append(run.dataset)
    return [datasets for datasets in by_files.values() if len(datasets) > 1]


def joined_text(group: Group, joined: Joined) -> str:
    """Return the words of a ``joined`` verdict without the robot's name, "" without evidence:
    number of cases that hold, datasets in which the claim fails, causes, and reasons.
    """
    if joined.word == UNKNOWN:
        return ""
    if joined.word == FORCED:
        return WORDS["marks"][FORCED]
    mark = WORDS["marks"].get(joined.word, "") if decides(group, joined.claim) else ""
    over_causes = _of_causes([*joined.by_cause.values()])
    parts = [_over_causes(joined, over_causes)] if joined.by_cause else []
    for word in (FAILS, HOLDS, SPEED_LAW):
        names = [name for name in joined.datasets(word) if name not in group.cause_of]
        if names and word != over_causes:
            parts.append(_in_datasets(group, joined, word, names))
    reasons = [
        f"{joined.claim.why[name]} ({name})"
        for name in joined.datasets(FAILS)
        if name in joined.claim.why
    ]
    if reasons:
        parts.append(f"reason: {', '.join(reasons)}")
    return f"{mark} {'; '.join(parts)}".strip()


def _over_causes(joined: Joined, word: str) -> str:
    """Return the verdict ``word`` on the synthetic recordings of one arm over their causes."""
    outcomes = joined.by_cause.items()
    if word == DEPENDS:
        failing = ", ".join(cause for cause, outcome in outcomes if outcome == FAILS)
        holding = ", ".join(cause for cause, outcome in outcomes if outcome != FAILS)
        return f"{DEPENDS} (holds: {holding}; fails: {failing})"
    count = len(outcomes)
    under = f"under {count} of {count} causes" if count > 1 else ""
    first = joined.by_dataset[joined.datasets(word)[0]]
    return _outcome_text(word, under) + _in_brackets(case_text(first))


def _outcome_text(word: str, where: str) -> str:
    """Return an outcome with the words ``where`` after its verb."""
    verb, comma, more = SHORT.get(word, word).partition(",")
    return f"{verb} {where}".strip() + comma + more


def _in_datasets(group: Group, joined: Joined, word: str, names: Sequence[str]) -> str:
    """Return the outcome ``word`` in the datasets ``names``, with the cases that hold: of the first
    if the claim holds, of each if it fails.
    """
    brackets = {}
    for name in names:
        text = _count_text(group, joined.by_dataset[name])
        brackets[name] = _in_brackets(text)
    first = brackets[names[0]]
    if len(group.verdicts) == 1:
        return _outcome_text(word, "") + first
    if word == FAILS:
        failing = join_names(name + text for name, text in brackets.items())
        return _outcome_text(word, f"in {failing}")
    holding = join_names(names)
    return _outcome_text(word, f"in {holding}") + first


def _in_brackets(text: str) -> str:
    return f" ({text})" if text else ""


def _count_text(group: Group, verdict: Verdict) -> str:
    """Return the cases that hold; on real recordings with the correlations of a claim of course."""
    texts = [case_text(verdict)]
    if not group.synthetic:
        texts.append(correlations(verdict))
    return ", ".join(filter(None, texts))


def case_text(verdict: Verdict) -> str:
    """Return the value of a verdict's only case, or the number of its cases that hold: "" if all
    hold.
    """
    several = len(verdict.cases) > 1
    return (
        ""
        if several and all(case.holds for case in verdict.cases)
        else case_count(verdict)
    )


def correlations(verdict: Verdict) -> str:
    """Return the ranges of correlation, limit and power over the cases of a claim that a curve
    follows another, "" for other claims.
    """
    if verdict.claim.rule != "follows":
        return ""
    texts = []
    for name, key in FOLLOWS_NUMBERS.items():
        values = [getattr(case, key) for case in verdict.cases]
        values = [value for value in values if value is not None]
        if not values:
            continue
        low = number(min(values), 2)
        high = number(max(values), 2)
        texts.append(f"{name} {low}" if low == high else f"{name} {low}–{high}")
    return ", ".join(texts)


def _value_text(verdict: Verdict) -> str:
    """Return the value of a verdict's only case, in per cent with its interval if the claim is; of
    an order of two values their difference, which decides it.
    """
    case = verdict.cases[0]
    if case.difference is not None:
        return f"difference {number(case.difference, 3)}"
    if "%" not in verdict.claim.statement or case.value is None:
        return number(case.value)
    value = number(100 * case.value, 3)
    if case.low is None or case.high is None:
        return f"{value} %"
    low = number(100 * case.low, 3)
    high = number(100 * case.high, 3)
    return f"{value} %, interval {low} to {high} %"


def case_count(verdict: Verdict) -> str:
    """Return the value of a verdict's only case, or the number of its cases that hold."""
    if len(verdict.cases) == 1:
        return _value_text(verdict)
    holding = [case for case in verdict.cases if case.holds]
    return f"{len(holding)} of {len(verdict.cases)}"
