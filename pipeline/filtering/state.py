"""What the compiled filter works on: the domain of the joints, the measurements that are due, the
particles, and the record of how they fared.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, types

from pipeline.core.compiled import MATRIX, VECTOR
from pipeline.filtering.resampling import COUNTS
from pipeline.models.commands import Commands
from pipeline.models.law import CUBE, ROW


class Domain(NamedTuple):
    """D_q: the joint limits and, of the second joint, the angle at which the first two links are in
    line and how clear of that it is to be.

    |det J| is the product of both links' lengths and the sine of the angle between them, which the
    second joint alone decides.
    """

    lower: tuple[float, float, float]  # rad
    upper: tuple[float, float, float]  # rad
    straight: float  # rad, up to half turns
    clearance: float  # rad


class Frames(NamedTuple):
    """The F measurements in the order in which they enter: frames first[k] to first[k+1] when step
    k is done.

    The density of y at the pose q is exp(log_norm − ‖whitening·(y − bias − q)‖²/2), q the pose at
    ``share`` of the step.
    """

    first: np.ndarray  # (M+2,)
    share: np.ndarray  # (F,)
    unbiased: np.ndarray  # (F, 3) y − bias, rad
    whitening: np.ndarray  # (F, 3, 3) lower triangular, 1/rad
    log_norm: np.ndarray  # (F,)


class Particles(NamedTuple):
    """P particles: where they are and were, and room for their weights and for what resampling does
    with them.
    """

    q: np.ndarray  # (3, P) rad
    before: np.ndarray  # (3, P)
    weights: np.ndarray  # (P,)
    log_weights: np.ndarray  # (P,)
    chosen: np.ndarray  # (P,) int
    room: np.ndarray  # (2, P)


class Record(NamedTuple):
    """The fields of a Posterior that are filled step by step, on the grid k = 0 … M; the counts
    begin at zero.
    """

    mean: np.ndarray  # (M+1, 3) rad
    covariance: np.ndarray  # (M+1, 3, 3) rad²
    ess: np.ndarray  # (M+1,)
    resampled: np.ndarray  # (M+1,) bool
    clipped: np.ndarray  # (M+1,) int
    outside: np.ndarray  # (M+1,) int


COMMANDS = types.NamedTuple((MATRIX, MATRIX, float64), Commands)
DOMAIN = types.NamedTuple((ROW, ROW, float64, float64), Domain)
FRAMES = types.NamedTuple((COUNTS, VECTOR, MATRIX, CUBE, VECTOR), Frames)
PARTICLES = types.NamedTuple((MATRIX, MATRIX, VECTOR, VECTOR, COUNTS, MATRIX), Particles)
RECORD = types.NamedTuple(
    (MATRIX, CUBE, VECTOR, types.Array(boolean, 1, "C"), COUNTS, COUNTS), Record
)
