"""Verdict on a take among others: its innovations in the filter of a motion model's first two
moments, and their log evidence as a whole, joint by joint and over time.

Between two measured poses the law of a step is taken for the normal one of its mean and covariance,
the mean's slope F by differences (the extended Kalman filter; Anderson & Moore, Optimal Filtering,
1979, Sec. 8.2):

    x⁻ = E(q_{k+1} | x),   P⁻ = F P Fᵀ + Cov(q_{k+1} | x),   S = P⁻ + Σ,   G = P⁻S⁻¹,
    x = x⁻ + G(y − x⁻),   P = (I − G)P⁻.

The evidence of a take is the mean over its steps of ln N(e; 0, S), of its innovations e = y − x⁻.
Its distance from N others is t = (x − x̄)/(s√(1 + 1/N)), not Student's, as log evidence is skew and
heavy-tailed. So each of the others is compared with the rest likewise, and p is the rank among
these, exact for takes that may be exchanged (Vovk et al., Algorithmic Learning in a Random World,
2005). Of several quantities the greatest |t| counts.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.exported import ExportedModel
from pipeline.models.model import Commands
from pipeline.statistics.scores import normal_log_score

DIFFERENCE = 1e-5  # rad
# share of takes of the same kind called different, half of it as a whole and half by a span
LEVEL = 0.05
MOST_CHANCE = 0.25  # the same share of few takes, above which nothing can be shown
FEWEST = round(2 / MOST_CHANCE) - 1  # takes to compare with, so that a difference can be shown
SPANS = 10  # parts of the motion that are looked at one by one


class Innovations(NamedTuple):
    """Measured minus predicted poses ``error`` (T, M, n) in rad of T takes, and the predicted
    ``covariance`` S (T, M, n, n) in rad².
    """

    error: np.ndarray
    covariance: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """(T, M, n) rad, by joint."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))


class TakeVerdict(NamedTuple):
    """Distance of a take from N others, of all joints together and of each."""

    names: Sequence[str]  # "all joints", then each
    evidence: np.ndarray  # (1 + n,) nats a step
    theirs: np.ndarray  # (1 + n, 2) mean and standard deviation of the others' evidence
    p: np.ndarray  # (1 + n,) of each evidence
    p_whole: float  # of the farthest of these
    ends: np.ndarray  # (SPANS + 1,) s, of the spans
    span_t: np.ndarray  # (n, SPANS) t of each joint in each span
    p_spans: float  # of the farthest of these
    others: np.ndarray  # (T,) True of the takes it was compared with

    @property
    def limit(self) -> float:
        """Greatest p of a take that is called different: of few takes the least that there is."""
        return max(LEVEL / 2, 1 / (1 + self.others.sum()))

    @property
    def behaves(self) -> bool:
        """True where neither the whole nor a span is unlike the others'."""
        return bool(min(self.p_whole, self.p_spans) > self.limit)

    @property
    def shows(self) -> bool:
        """True where there are enough takes to compare with for a difference to be shown."""
        return bool(2 * self.limit <= MOST_CHANCE)


def filtered(model: ExportedModel, commands: Commands, poses: np.ndarray) -> Innovations:
    """Return the innovations of the measured ``poses`` (T, M+1, n) in rad under the ``commands``.

    The noise Σ of a measured pose is the exported one; none where it is not known. Raises
    ModelDomainError where the model has no moments, or no noise at a pose.
    """
    known, n = model.record["pose_covariance_rad2"], poses.shape[-1]
    noise = np.zeros((n, n)) if known is None else np.array(known)
    x, P = poses[:, 0], np.broadcast_to(noise, (len(poses), n, n))
    found = []
    shifts = DIFFERENCE * np.concatenate([np.eye(n), -np.eye(n)])[:, None]
    for k, (v, target) in enumerate(zip(commands.v, commands.path, strict=False)):
        places = np.concatenate([x[None], x + shifts])
        ahead = model.mean(places, model.command(places, v, target))
        F = np.moveaxis(ahead[1 : n + 1] - ahead[n + 1 :], 0, -1) / (2 * DIFFERENCE)
        P = F @ P @ np.swapaxes(F, -1, -2) + model.covariance(x, model.command(x, v, target))
        x, S = ahead[0], P + noise
        e = poses[:, k + 1] - x
        found.append((e, S))
        try:
            G = np.swapaxes(np.linalg.solve(S, P), -1, -2)
        except np.linalg.LinAlgError:
            message = "the model has no noise at a pose, so no measurement can be compared with it;"
            advice = "state dataset.motion.pose_noise and export it again"
            raise ModelDomainError(f"{message} {advice}", step=k) from None
        x, P = x + np.matvec(G, e), P - G @ P
        P = (P + np.swapaxes(P, -1, -2)) / 2
    return Innovations(*(np.stack(each, axis=1) for each in zip(*found, strict=True)))


def judge(
    found: Innovations, number: int, others: np.ndarray, joints: Sequence[str], rate: float
) -> TakeVerdict:
    """Return the verdict on take ``number`` of the T takes of ``found`` among the ``others`` (T,),
    a mask; ``joints`` are the names of the n joints, ``rate`` is in steps a second.
    """
    z = found.error / found.std
    alone = -0.5 * (z**2 + np.log(2 * np.pi)) - np.log(found.std)
    together = normal_log_score(found.error, found.covariance)
    each = np.concatenate([together[..., None], alone], axis=-1)  # (T, M, 1 + n)
    whole = each.mean(axis=1)
    steps = np.array_split(np.arange(each.shape[1]), SPANS)
    spans = np.stack([each[:, part, 1:].mean(axis=1) for part in steps], axis=-1)
    t, their_t = _distances(whole[others], whole[number])
    span_t, their_span_t = _distances(spans[others], spans[number])
    return TakeVerdict(
        names=["all joints", *joints],
        evidence=whole[number],
        theirs=np.stack([whole[others].mean(axis=0), whole[others].std(axis=0, ddof=1)], axis=-1),
        p=np.array([_rank(one, rest) for one, rest in zip(t, their_t.T, strict=True)]),
        p_whole=_rank(t, their_t),
        ends=np.array([0, *(part[-1] + 1 for part in steps)]) / rate,
        span_t=span_t,
        p_spans=_rank(span_t, their_span_t),
        others=others,
    )


def _distances(theirs: np.ndarray, one: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """t of ``one`` (...) among ``theirs`` (N, ...), and t of each of these among the rest."""

    def distance(one: np.ndarray, rest: np.ndarray) -> np.ndarray:
        scale = rest.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(rest))
        return (one - rest.mean(axis=0)) / scale

    others = [np.delete(theirs, i, axis=0) for i in range(len(theirs))]
    return distance(one, theirs), np.stack(list(map(distance, theirs, others)))


def _rank(t: np.ndarray, theirs: np.ndarray) -> float:
    """p of the greatest |``t``| among the greatest of each of ``theirs`` (N, ...)."""
    greatest = np.abs(theirs).reshape(len(theirs), -1).max(axis=1)
    return float((1 + np.sum(greatest >= np.abs(t).max())) / (1 + len(theirs)))
