"""The verdicts on the paper's claims for people, as a section of a page, and for programs, as plain data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from pipeline.audit.claims import NO_EVIDENCE, NOT_REPRODUCED, REPRODUCED, SYNTHETIC_CANNOT, Case, Claim, Recordings, Verdict, decide
from pipeline.audit.results import number, table
from pipeline.audit.run import Run

# what a claim is about → which recordings can decide it, and why others cannot
GROUPS = {
    "method": (
        "What any recordings can decide, synthetic ones too",
        "Claims about the method: that an estimator, a model or a bound does what is said of it. The synthetic laboratory knows the truth, "
        "and its physics is none of the models.",
    ),
    "robots": (
        "What only a real robot's recordings can decide",
        "Claims about what real robots and sensors do. Synthetic recordings do what their laboratory was told to: their numbers are shown, "
        "and no verdict is given.",
    ),
    "specimen": (
        "What only the paper's own recordings could decide",
        "Claims about the very robot of the paper. Nobody has published its recordings; the synthetic laboratory was tuned towards these "
        "numbers, so that nearness is no evidence.",
    ),
}
VERDICTS = (REPRODUCED, NOT_REPRODUCED, SYNTHETIC_CANNOT, NO_EVIDENCE)
WHOSE = {"synthetic": "synthetic recordings", "real": "recordings of a real robot, not the paper's", "paper": "the paper's own recordings"}


@dataclass(frozen=True)
class Decided:
    """The verdicts on all claims from the recordings of one dataset."""

    dataset: str
    recordings: Recordings
    verdicts: Sequence[Verdict]

    @property
    def summary(self) -> str:
        """How many claims have which verdict, in words."""
        count = Counter(of.verdict for of in self.verdicts)
        return ", ".join(f"{count[verdict]} {verdict}" for verdict in VERDICTS if count[verdict])


def decide_each(claims: Sequence[Claim], runs: Sequence[Run], of_the_paper: list[str]) -> list[Decided]:
    """Every claim from every run's numbers; ``of_the_paper`` names the datasets that are the paper's own recordings."""
    whose = [run.recordings(of_the_paper) for run in runs]
    return [Decided(run.dataset, of, decide(claims, run.evidence, of)) for run, of in zip(runs, whose, strict=True)]


def side_by_side(decided: Sequence[Decided], about: str) -> list[tuple[Claim, list[Verdict]]]:
    """Each claim about ``about`` with its verdicts in the order of the datasets."""
    rows = zip(*(of.verdicts for of in decided), strict=True)
    return [(row[0].claim, list(row)) for row in rows if row[0].claim.about == about]


def verdict_section(decided: Sequence[Decided]) -> str:
    """The verdicts in words and as tables; a value for which the claim's test fails is marked."""
    sections = [
        "## What holds of the paper's claims",
        "\n".join(f"- **{of.dataset}** ({WHOSE[of.recordings]}): of {len(of.verdicts)} claims {of.summary}." for of in decided),
        "Each claim with its published value and its test stands in `reports/claims.yaml`, with what is here in full in `claims.json`. "
        "✗ marks a value for which the test fails, brackets hold 95 % intervals, and what a value is compared with follows it.",
    ]
    header = ["claim", "published", "test", *(of.dataset for of in decided), "recompute"]
    for about, (title, reason) in GROUPS.items():
        rows = [
            [
                f"{claim.statement} ({claim.where})",
                "<br>".join(published(claim)) or "–",
                f"{measured(claim)}: {claim.test}",
                *(f"**{of.verdict}**<br>{'<br>'.join(map(case_text, of.cases))}" for of in verdicts),
                f"`{verdicts[0].command}`",
            ]
            for claim, verdicts in side_by_side(decided, about)
        ]
        if rows:
            sections += [f"### {title}", reason, table(header, rows)]
    if distances := distance_rows(decided):
        sections += [
            "### How far published averages over random systems lie from their expectation",
            "In standard errors of such an average.",
            table(["published", "entry", "value", "expectation", "distance"], distances),
        ]
    return "\n\n".join(sections)


def published(claim: Claim) -> list[str]:
    """The published values, none or one or one a case."""
    values = claim.published if isinstance(claim.published, list) else [claim.published]
    return [number(value) for value in values if value is not None]


def measured(claim: Claim) -> str:
    """The quantity that decides the claim, with its unit."""
    return f"{claim.quantity} in {claim.unit}" if claim.unit else claim.quantity


def case_text(case: Case) -> str:
    """One case of a claim: its name, value, interval, what it is compared with, and whether the test fails."""
    if case.value is None:
        return f"{case.case} –".strip()
    text = f"{case.case}: {number(case.value)}" if case.case else number(case.value)
    if case.low is not None and case.high is not None:
        text += f" [{number(case.low)}, {number(case.high)}]"
    if case.than is not None:
        text += f" against {number(case.than)}"
    return f"{text} ✗" if case.holds is False else text


def distance_rows(decided: Sequence[Decided]) -> list[list[str]]:
    """Place, case, published value, expectation and distance of every number that has one, of the first dataset that has them."""
    for of_dataset in decided:
        rows = [
            [of.claim.where, case.case, number(case.published), number(case.value), f"{case.distance:+.2f}"]
            for of in of_dataset.verdicts
            for case in of.cases
            if case.published is not None and case.value is not None and case.distance is not None
        ]
        if rows:
            return rows
    return []


def verdict_data(decided: Sequence[Decided]) -> list[dict]:
    """Each claim with its verdicts by dataset as plain data that JSON can hold."""
    return [
        {
            "id": of[0].claim.id,
            "where": of[0].claim.where,
            "statement": of[0].claim.statement,
            "about": of[0].claim.about,
            "quantity": of[0].claim.quantity,
            "unit": of[0].claim.unit,
            "test": of[0].claim.test,
            "reason": of[0].claim.reason,
            "command": of[0].command,
            "evidence": [reference.address for reference in of[0].claim.references],
            "datasets": {
                run.dataset: {"verdict": verdict.verdict, "cases": [asdict(case) for case in verdict.cases]}
                for run, verdict in zip(decided, of, strict=True)
            },
        }
        for of in zip(*(of.verdicts for of in decided), strict=True)
    ]
