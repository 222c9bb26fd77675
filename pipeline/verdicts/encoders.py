"""Noise of a step that the encoders of a real arm show, beside the published noise of the arm, and
verdicts within a single run.
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.verdicts.claims import Claim
from pipeline.verdicts.decision import NO_EVIDENCE, Case, Verdict
from pipeline.verdicts.run import Run
from pipeline.verdicts.tally import Group
from pipeline.verdicts.wording import join_names, number, say

TABLE = "step_noise"  # of pipeline.evidence.step_noise
VARIANCES = ("11", "22", "33")  # entries of the published Σ̂_ω
PUBLISHED = "sigma-omega"  # claim with the published Σ̂_ω
QUANTITIES = {PUBLISHED: "covariance", "correlation-omega": "correlation"}


class EncoderNoise(NamedTuple):
    """Covariance (n, n) in rad² and correlation (n, n) of the changes of the tracking errors in one
    step of the paper, by the encoders in the logs of ``dataset``.
    """

    dataset: str
    covariance: ndarray
    correlation: ndarray

    def values(self, claim: str, cases: Sequence[Case]) -> list[float]:
        """Return the numbers of the ``cases`` of a ``claim`` on entries of a matrix, else []."""
        if claim not in QUANTITIES:
            return []
        matrix = getattr(self, QUANTITIES[claim])
        return [matrix[int(case.case[0]) - 1, int(case.case[1]) - 1] for case in cases]

    @property
    def std(self) -> ndarray:
        """Standard deviations (n,) in rad."""
        return np.sqrt(np.diag(self.covariance))


def encoder_noise(runs: Sequence[Run], joints: Sequence[str]) -> EncoderNoise | None:
    """Return the noise of the ``joints`` in the first of the real ``runs`` that has all of them, or
    None.
    """
    for run in runs:
        rows = run.tables.get(TABLE, pd.DataFrame())
        if run.synthetic or rows.empty or not joints:
            continue
        pairs = rows[rows["steps"] == "all"].set_index(["joint", "other"])
        if not {(joint, joint) for joint in joints} <= {*pairs.index}:
            continue
        entries = [*product(joints, joints)]
        matrices = []
        for quantity in ("covariance", "correlation"):
            by_pair = pairs[quantity].to_dict()
            values = [by_pair.get(pair, by_pair.get(pair[::-1])) for pair in entries]
            matrices.append(np.reshape(values, (len(joints),) * 2).astype(float))
        return EncoderNoise(run.dataset, *matrices)
    return None


def std_texts(noise: EncoderNoise | None, joints: Sequence[str]) -> str:
    """Return the standard deviations in mrad by joint, "" without ``noise``."""
    if noise is None:
        return ""
    stds = zip(noise.std, joints, strict=True)
    return join_names(f"{number(1e3 * std, 3)} ({joint})" for std, joint in stds)


def encoder_sentence(groups: Sequence[Group]) -> str:
    """Return the sentence on the published noise over the encoders' noise of a real arm, "" without
    logs of the joints of the laboratory's arm with the published numbers.
    """
    numbered = [group for group in groups if group.runs and group.runs[0].arm.numbered]
    published = published_std(next(iter(groups[0].verdicts.values())))
    if not numbered or published is None:
        return ""
    papers = max(numbered, key=lambda group: len({*group.cause_of.values()}))
    for group in groups:
        noise = encoder_noise(group.runs, papers.runs[0].joints)
        if noise is None:
            continue
        ratios = published / noise.std
        words = {
            "robot": group.robot,
            "low": number(1e3 * noise.std.min(), 2),
            "high": number(1e3 * noise.std.max(), 2),
            "least": number(ratios.min(), 2),
            "greatest": number(ratios.max(), 2),
        }
        return say("finding_encoders", **words)
    return ""


def published_std(verdicts: Sequence[Verdict]) -> ndarray | None:
    """Return the published standard deviations (3,) of the noise of a step in rad, None without the
    claim PUBLISHED.
    """
    for verdict in verdicts:
        claim = verdict.claim
        if claim.id == PUBLISHED:
            published = dict(zip(claim.each["entry"], claim.published, strict=True))
            return np.sqrt([published[entry] for entry in VARIANCES])
    return None


def within_run_sentences(groups: Sequence[Group]) -> list[str]:
    """Return a sentence for each dataset and claim that is tested within a single run."""
    sentences = []
    for group in groups:
        for dataset, verdicts in group.verdicts.items():
            for verdict in verdicts:
                if within_run(verdict):
                    words = {"dataset": dataset, "claim": verdict.claim.id}
                    words["cases"] = verdict.cases
                    sentences.append(say("within_run", **words))
    return sentences


def within_run(verdict: Verdict) -> bool:
    """Return True for a verdict from a single run: a power, and no limit over takes."""
    varying = verdict.claim.rule == "varies" and len(verdict.cases) > 0
    return varying and all(
        case.power is not None and case.threshold is None for case in verdict.cases
    )


def undecided_text(verdict: Verdict) -> str:
    """Return the number of cases that hold and the range of the powers of undecided cases."""
    holding = sum(case.holds is True for case in verdict.cases)
    powers = [case.power for case in verdict.cases if case.holds is None]
    low = number(min(powers), 2)
    high = number(max(powers), 2)
    count = f"{holding} of {len(verdict.cases)} hold"
    return f"no verdict: {count}, power of the others {low}–{high}"


def undecided_in_run(group: Group, claim: Claim) -> str:
    """Return the text of a ``claim`` that a single run of the ``group`` tests and does not decide,
    "" for any other claim.
    """
    for verdicts in group.verdicts.values():
        for verdict in verdicts:
            undecided = verdict.verdict == NO_EVIDENCE and within_run(verdict)
            if verdict.claim.id == claim.id and undecided:
                return undecided_text(verdict)
    return ""
