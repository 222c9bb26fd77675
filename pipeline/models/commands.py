"""What the arm is commanded over the steps of a motion, in an open or in a closed loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Commands(NamedTuple):
    """The commands of M steps of m task rows: v_k + κ(x*_k − x(q_k)) of the pose q_k before each
    step.
    """

    v: np.ndarray  # (M, m) steps (m, m, rad)
    path: np.ndarray  # (M, m) x* before each step (m, m, rad)
    share: float  # κ, of the deviation from the path that a step corrects; 0 of an open loop


def open_loop(v: np.ndarray) -> Commands:
    """Steps ``v`` (M, m) whatever the pose."""
    return Commands(v, np.zeros_like(v), 0.0)
