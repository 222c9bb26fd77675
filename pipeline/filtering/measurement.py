"""Measurements of an arm during one take, with a bias and a covariance per frame: of the joints,
y_j = q(t_j) + b_j + N(0, R_j), or of the pose of the tip, whose displacement from the pose at
q(t_j) is b_j + N(0, R_j).

The paper does not say how frames at 30 Hz meet a motion grid of 100 Hz. A model's velocity is
constant within a step: its path is the polygon through the q_k, and a frame is compared with the
particle's polygon at the frame's time, when the step is done: the exact likelihood of that path.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core.columns import matrices, members, values
from pipeline.core.errors import ModelDomainError

# shares of a step are rounded, so that 0.03 s / 0.01 s is step 3 and not just past it
SHARE_DIGITS = 6
# ratio of the least to the greatest variance of R below which rounding decides its sign
SINGULAR_VARIANCE = 1e-12


class Frames(NamedTuple):
    """The F measurements in the order in which they enter: frames first[k] to first[k+1] when step
    k is done.

    The density of y at the pose q is exp(log_norm − ‖whitening·e‖²/2), e being y − bias − q or the
    displacement of the tip from its pose at q, and q the pose at ``share`` of the step.
    """

    first: np.ndarray  # (M+2,)
    share: np.ndarray  # (F,)
    unbiased: np.ndarray  # (F, n) joint angles, rad, or (F, 12) poses of the tip, without bias
    whitening: np.ndarray  # (F, d, d) lower triangular, 1/rad or 1/m
    log_norm: np.ndarray  # (F,)
    tip: bool  # true for poses of the tip


@dataclass(frozen=True)
class Measurements:
    """The F ≥ 0 frames of one take.

    A pose of the tip is its position and its rotation, row by row, displaced by d = 6 numbers, a
    way and a rotation vector, in m and rad in the base's axes. Of n joint angles d is n.
    """

    take: str
    t: np.ndarray  # (F,) times on the motion clock, s, in any order
    y: np.ndarray  # (F, n) measured joint angles, rad, or (F, 12) poses of the tip
    bias: np.ndarray  # (F, d) mean of the noise
    covariance: np.ndarray  # (F, d, d) covariance R of the noise
    tip: bool = False  # true for poses of the tip

    def schedule(self, steps: int, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return frames, steps k and shares of the step (F',) of the frames within ``steps`` steps
        of ``dt`` (s), in the order in which they enter: a frame at t_k has share 1 of the step that
        ends there, one at the start of the motion share 1 of k = 0.
        """
        position = np.round(self.t / dt, SHARE_DIGITS)
        frame = np.flatnonzero((position >= 0) & (position <= steps))
        frame = frame[np.argsort(np.ceil(position[frame]), kind="stable")]
        step = np.ceil(position[frame]).astype(int)
        return frame, step, position[frame] - step + 1

    def frames(self, steps: int, dt: float) -> Frames:
        """Return the frames of :meth:`schedule`; raises ModelDomainError like :attr:`whitening`."""
        chosen, step, share = self.schedule(steps, dt)
        whitening, log_norm = self.whitening
        first, unbiased = np.searchsorted(step, np.arange(steps + 2)), self.unbiased[chosen]
        return Frames(first, share, unbiased, whitening[chosen], log_norm[chosen], self.tip)

    @cached_property
    def unbiased(self) -> np.ndarray:
        """(F, n) or (F, 12): ``y`` without its bias."""
        if not self.tip:
            return self.y - self.bias
        from scipy.spatial.transform import Rotation

        back = Rotation.from_rotvec(-self.bias[:, 3:]).as_matrix()
        turn = back @ self.y[:, 3:].reshape(-1, 3, 3)
        return np.hstack([self.y[:, :3] - self.bias[:, :3], turn.reshape(-1, 9)])

    @cached_property
    def whitening(self) -> tuple[np.ndarray, np.ndarray]:
        """(F, d, d) lower triangular inverses of the Cholesky factors of R, and (F,) logarithms of
        the normal density's constant. Raises ModelDomainError where R is not positive definite.
        """
        variances = np.linalg.eigvalsh(self.covariance)
        singular = variances[:, 0] <= SINGULAR_VARIANCE * variances[:, -1]
        if singular.any():
            message = "the covariance of the measurement's noise is not positive definite; estimate"
            where = {"take": self.take, "frame": int(np.argmax(singular))}
            raise ModelDomainError(f"{message} it from more takes than joints", **where)
        factor = np.linalg.cholesky(self.covariance)
        log_determinant = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        return np.linalg.inv(factor), -log_determinant - 0.5 * factor.shape[-1] * np.log(2 * np.pi)


def measurements(angles: pd.DataFrame, noise: pd.DataFrame) -> list[Measurements]:
    """Return the depth camera's measurements of every take, each with the noise estimated without
    that take, from the tables ``angles`` and ``kinect_noise``.
    """
    names, takes = members(angles, "q"), []
    for take, rows in angles.groupby("take"):
        others = noise[noise["take"] == take].set_index("frame")
        # a frame at which no other take has one has no noise estimate
        rows = rows[rows["frame"].isin(others.index)]
        others = others.loc[rows["frame"]]
        t, q, bias = rows["t"].to_numpy(), values(rows, "q"), values(others, "b")
        takes.append(Measurements(str(take), t, q, bias, matrices(others, "r", names)))
    return takes
