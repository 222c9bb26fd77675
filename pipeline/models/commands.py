"""What the arm is commanded over the steps of a motion, in an open or in a closed loop.

The command of a step is the task step v (m,) or, of an arm of more joints than task rows, v and a
step w (n,) of the joints, of which the part in the null space of J is made: v and w in one row,
(m + n,). The arm rests where all of it is zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arm.interface import Mechanism


class Commands(NamedTuple):
    """The commands of M steps of m task rows: v_k + κ(x*_k − x(q_k)) of the pose q_k before each
    step.
    """

    v: np.ndarray  # (M, m) or (M, m + n)
    path: np.ndarray  # (M, p) x* before each step, as the chain has a pose
    share: float  # κ, of the deviation from the path that a step corrects; 0 of an open loop


def task_step(chain: Mechanism, command: np.ndarray) -> np.ndarray:
    """(..., m) v of the ``command`` (..., m) or (..., m + n)."""
    return command[..., : len(chain.task)]


def open_loop(v: np.ndarray) -> Commands:
    """Commands ``v`` (M, m) or longer, whatever the pose."""
    return Commands(v, np.zeros_like(v), 0.0)
