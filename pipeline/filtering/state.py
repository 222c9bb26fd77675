"""What the compiled filter works on: the domain of the joints, the measurements that are due, the
particles, and the record of how they fared.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Domain(NamedTuple):
    """D_q: the joint limits and, of a planar chain's second joint, the angle at which the first two
    links are in line and how clear of that it is to be.

    |det J| of a planar chain is the product of both links' lengths and the sine of the angle
    between them, which the second joint alone decides. Any other arm has no such angle: its law
    makes no step from a singular pose, so that a particle leaves D_q with its next step.
    """

    lower: np.ndarray  # (n,) rad
    upper: np.ndarray  # (n,) rad
    straight: float  # rad, up to half turns
    clearance: float  # rad; zero where there is no such angle


class Frames(NamedTuple):
    """The F measurements in the order in which they enter: frames first[k] to first[k+1] when step
    k is done.

    The density of y at the pose q is exp(log_norm − ‖whitening·e‖²/2), e being y − bias − q, or the
    displacement of the tip from where q carries it, and q the pose at ``share`` of the step.
    """

    first: np.ndarray  # (M+2,)
    share: np.ndarray  # (F,)
    unbiased: np.ndarray  # (F, n) joint angles, rad, or (F, 12) poses of the tip, without bias
    whitening: np.ndarray  # (F, d, d) lower triangular, 1/rad or 1/m
    log_norm: np.ndarray  # (F,)
    tip: bool  # whether they are poses of the tip


class Particles(NamedTuple):
    """P particles: where they are and were, and buffers for their weights and for resampling."""

    q: np.ndarray  # (n, P) rad
    before: np.ndarray  # (n, P)
    weights: np.ndarray  # (P,)
    log_weights: np.ndarray  # (P,)
    chosen: np.ndarray  # (P,) int
    scratch: np.ndarray  # (n + 2, P)


class Record(NamedTuple):
    """The fields of a Posterior that are filled step by step, on the grid k = 0 … M; the counts
    begin at zero.
    """

    mean: np.ndarray  # (M+1, n) rad
    covariance: np.ndarray  # (M+1, n, n) rad²
    ess: np.ndarray  # (M+1,)
    resampled: np.ndarray  # (M+1,) bool
    clipped: np.ndarray  # (M+1,) int
    outside: np.ndarray  # (M+1,) int
