"""Whether a take's log evidence is that of the takes a model was fitted to, as a whole, joint by
joint and over time.

The evidence of a take is the mean over its steps of ln N(e; 0, S), of its innovations e, over the
whole motion or a span of it. How far it is off that of N others is t = (x − x̄)/(s√(1 + 1/N)); it
is not Student's, as log evidence is skew and heavy-tailed. So each of the others is held against
the rest likewise, and p is the rank among these, exact for takes that may be exchanged (Vovk et
al., Algorithmic Learning in a Random World, 2005). Of several quantities the greatest |t| counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.statistics.scores import normal_log_score
from pipeline.tools.assess.moment_filter import Innovations

# how often a take of the same kind is called another, half of it as a whole and half by a span
LEVEL = 0.05
SPANS = 10  # parts of the motion that are looked at one by one
ALL = "all joints"


@dataclass(frozen=True)
class Verdict:
    """How a take stands among N others."""

    names: Sequence[str]  # all joints together, then each
    evidence: np.ndarray  # (1 + n,) nats a step
    theirs: np.ndarray  # (1 + n, 2) mean and standard deviation of the others' evidence
    p: np.ndarray  # (1 + n,) of each evidence
    p_whole: float  # of the farthest of these
    ends: np.ndarray  # (SPANS + 1,) s, of the spans
    span_t: np.ndarray  # (n, SPANS) t of each joint in each span
    p_spans: float  # of the farthest of these
    others: np.ndarray  # (T,) which of the takes it was held against

    @property
    def limit(self) -> float:
        """The p from which down it is called unlike them: of few takes the least that there is."""
        return max(LEVEL / 2, 1 / (1 + self.others.sum()))

    @property
    def behaves(self) -> bool:
        """Whether neither the whole nor a span is unlike the others'."""
        return bool(min(self.p_whole, self.p_spans) > self.limit)


def judge(
    found: Innovations, number: int, others: np.ndarray, joints: Sequence[str], rate: float
) -> Verdict:
    """The verdict on take ``number`` of ``found``.

    Args:
        found: of T takes.
        number: of the take that is judged.
        others: (T,) which takes it is held against.
        joints: names of the n joints.
        rate: steps a second.
    """
    each = evidence(found)
    whole = each.mean(axis=1)
    steps = np.array_split(np.arange(each.shape[1]), SPANS)
    spans = np.stack([each[:, part, 1:].mean(axis=1) for part in steps], axis=-1)
    t, their_t = _distances(whole, others, number)
    span_t, their_span_t = _distances(spans, others, number)
    theirs = whole[others]
    return Verdict(
        [ALL, *joints],
        whole[number],
        np.stack([theirs.mean(axis=0), theirs.std(axis=0, ddof=1)], axis=-1),
        np.array([_rank(one, rest) for one, rest in zip(t, their_t.T, strict=True)]),
        _rank(t, their_t),
        np.array([0, *(part[-1] + 1 for part in steps)]) / rate,
        span_t,
        _rank(span_t, their_span_t),
        others,
    )


def evidence(found: Innovations) -> np.ndarray:
    """(T, M, 1 + n) nats of every step: of all joints together, then of each alone."""
    z = found.error / found.std
    alone = -0.5 * (z**2 + np.log(2 * np.pi)) - np.log(found.std)
    together = normal_log_score(found.error, found.covariance)
    return np.concatenate([together[..., None], alone], axis=-1)


def _distances(
    values: np.ndarray, others: np.ndarray, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """t (...) of ``values[number]`` among the N ``others`` of ``values`` (T, ...), and (N, ...) of
    each of these among the rest.
    """
    theirs = values[others]
    rest = [_distance(one, np.delete(theirs, i, axis=0)) for i, one in enumerate(theirs)]
    return _distance(values[number], theirs), np.stack(rest)


def _distance(one: np.ndarray, others: np.ndarray) -> np.ndarray:
    scale = others.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(others))
    return (one - others.mean(axis=0)) / scale


def _rank(t: np.ndarray, theirs: np.ndarray) -> float:
    """p of the greatest |``t``| among the greatest of each of ``theirs`` (N, ...)."""
    greatest = np.abs(theirs).reshape(len(theirs), -1).max(axis=1)
    return float((1 + np.sum(greatest >= np.abs(t).max())) / (1 + len(theirs)))
