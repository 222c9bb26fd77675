"""Where the segment of the tool ends in a fit: at the commanded end-effector, as the paper has it,
or where the points say; and the variables of either search.

With the commanded end the last segment of an arm that deviates from its command starts on the arm
and ends off it: the headings take the deviation up. With the fitted end the tool has its nominal
length and a heading of its own. A free length would grow to its bound, since an end beyond the
points costs nothing. One asymmetry of all points of the tool says how far aside it lies, not where
it points; the other of its ends no longer being given, each of its halves has its own: the outer
one is that of the fingers. So Eq. (KinObj) has a fourth term there, of the weight γ2.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pipeline.core.compiled import inner
from pipeline.core.elementary import sine_cosine
from pipeline.perception.articulation_objective import Frame, excess, value

# m; above every value of the objective that points within reach of an arm can give
INFEASIBLE = 1e3
STEP = 0.02  # m; first extent of the simplex: how far a node moves between frames at 30 Hz
# 1/m; a variable that moves by STEP takes a length from its nominal value to its bound
STRETCH = np.pi / 2 / STEP


class End(NamedTuple):
    """One way to end the last segment: variables v (n,) of a search, all in m, that say where O2,
    O3 and EE are.
    """

    variables: Callable[[Frame, np.ndarray], np.ndarray]  # frame, nodes (3, 2) → v
    nodes: Callable[[Frame, np.ndarray], np.ndarray]  # frame, v → nodes (3, 2)
    # of each of the runs of the simplex its first extent, and that at which it has ended, m
    runs: tuple[tuple[float, float], ...]


@inner
def at_commanded(frame: Frame, v: np.ndarray) -> float:
    """Eq. (KinObj) at v = (O2, O3), m; outside the bounds on the lengths INFEASIBLE and the excess.

    So any pose within the bounds ranks before any outside, and of two outside the one that violates
    them less (feasibility rules, Deb 2000): no weight has to be chosen.
    """
    o1, ee = (frame.o1[0], frame.o1[1]), (frame.ee[0], frame.ee[1])
    nodes = (o1, (v[0], v[1]), (v[2], v[3]), ee)
    violation = excess(frame, nodes)
    if not violation == 0.0:
        return INFEASIBLE + violation
    return value(frame, nodes, 3)


def _commanded_variables(frame: Frame, nodes: np.ndarray) -> np.ndarray:
    return nodes[:2].ravel()


def _commanded_nodes(frame: Frame, v: np.ndarray) -> np.ndarray:
    return np.vstack([v.reshape(2, 2), frame.ee])


@inner
def at_fitted(frame: Frame, v: np.ndarray) -> float:
    """The value, m, at v = (λ1, λ2, l1ψ1, l2ψ2, l3ψ3), l the nominal lengths and ψ the headings.

    The first two lengths are l(1 + r·sin(STRETCH·λ)), r the range of lengths: within their bounds
    at any λ (James and Roos 1975).
    """
    o1 = (frame.o1[0], frame.o1[1])
    o2 = _beyond(o1, frame.bounds[0, 0], frame.bounds[0, 1], v[0], v[2])
    o3 = _beyond(o2, frame.bounds[1, 0], frame.bounds[1, 1], v[1], v[3])
    ee = _beyond(o3, frame.bounds[2, 0], frame.bounds[2, 1], 0.0, v[4])
    return value(frame, (o1, o2, o3, ee), 4)


@inner
def _beyond(
    start: tuple[float, float], short: float, long: float, stretch: float, arc: float
) -> tuple[float, float]:
    """The end of a segment from ``start``, its length between ``short`` and ``long``."""
    middle, half = 0.5 * (short + long), 0.5 * (long - short)
    stretched, _ = sine_cosine(STRETCH * stretch)
    sine, cosine = sine_cosine(arc / middle)
    length = middle + half * stretched
    return start[0] + length * sine, start[1] + length * cosine


@inner
def rank(frame: Frame, v: np.ndarray) -> float:
    """Value, m, by which a search ranks the pose ``v`` of either end; the fitted end has five
    variables, the commanded one four.
    """
    return at_fitted(frame, v) if v.size == 5 else at_commanded(frame, v)


def _fitted_variables(frame: Frame, nodes: np.ndarray) -> np.ndarray:
    x, z = np.diff(np.vstack([frame.o1, nodes]), axis=0).T
    middle, half = _middle_and_half(frame)
    share = np.clip((np.hypot(x, z) - middle)[:-1] / half[:-1], -1.0, 1.0)
    return np.concatenate([np.arcsin(share) / STRETCH, middle * np.arctan2(x, z)])


def _fitted_nodes(frame: Frame, v: np.ndarray) -> np.ndarray:
    middle, half = _middle_and_half(frame)
    lengths = middle + half * np.append(np.sin(STRETCH * v[:2]), 0.0)
    psi = v[2:] / middle
    steps = lengths[:, None] * np.stack([np.sin(psi), np.cos(psi)], axis=-1)
    return frame.o1 + np.cumsum(steps, axis=0)


def _middle_and_half(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """(3,) the middle and half the width of the range of every length, m."""
    short, long = frame.bounds.T
    return (short + long) / 2, (long - short) / 2


# 1e-5 m are 1e-4 rad on a link, a hundredth of the errors of the sensor. The fitted end has one
# unknown more, and minima beside the least: a wider simplex leaves the one of the frame before,
# which would take back a share of what the arm has moved since. Its angles scatter too widely for
# the last digit to be worth its evaluations.
ENDS = {
    "commanded": End(_commanded_variables, _commanded_nodes, ((STEP, 1e-3), (-STEP / 2, 1e-5))),
    "fitted": End(
        _fitted_variables, _fitted_nodes, ((2 * STEP, 4e-3), (-2 * STEP, 4e-3), (STEP, 1e-4))
    ),
}
