"""What instruments say of the arm during one take, with a bias and a covariance per frame: of the
joints, y_j = q(t_j) + b_j + N(0, R_j), or of the pose of the tip, whose displacement from where the
joints carry it is b_j + N(0, R_j).

The paper does not say how frames at 30 Hz meet a motion grid of 100 Hz. The models step from q_k to
q_{k+1} under a velocity that is constant in between, and say nothing about a part of a step; the
path they define is the polygon through the q_k. A frame inside the step is therefore compared with
the point of the particle's own polygon at the frame's time, when the step is done: the exact
likelihood of that path, to which no process noise has to be invented or rescaled.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline.core.columns import matrices, members, values
from pipeline.core.errors import ContractError, ModelDomainError

# shares of a step are rounded to this many digits, so that 0.03 s / 0.01 s is step 3 and not just
# past it
SHARE_DIGITS = 6
# ratio of the least to the greatest variance of R below which rounding decides whether R is
# positive definite
SINGULAR_VARIANCE = 1e-12


@dataclass(frozen=True)
class Measurements:
    """The F frames of one take; ContractError where shapes disagree or a value is not finite, F = 0
    is allowed.

    A pose of the tip is its position and its rotation, row by row; d = 6 numbers displace it, a way
    and a rotation vector, in m and rad in the base's axes. Of n joint angles d is n.
    """

    take: str
    t: np.ndarray  # (F,) times on the motion clock, s, in any order
    y: np.ndarray  # (F, n) measured joint angles, rad, or (F, 12) poses of the tip
    bias: np.ndarray  # (F, d) mean of the noise
    covariance: np.ndarray  # (F, d, d) covariance R of the noise
    tip: bool = False  # whether the poses of the tip are what was measured

    def __post_init__(self) -> None:
        frames, d = len(self.t), 6 if self.tip else self.y.shape[-1]
        for name, shape in (
            ("t", (frames,)),
            ("y", (frames, 12 if self.tip else d)),
            ("bias", (frames, d)),
            ("covariance", (frames, d, d)),
        ):
            values = getattr(self, name)
            if values.shape != shape:
                raise ContractError(
                    f"measurements: {name} has shape {values.shape}, not {shape}", take=self.take
                )
            broken = np.argwhere(~np.isfinite(values))
            if len(broken):
                raise ContractError(
                    f"measurements: {name} is not finite; drop the frame before filtering",
                    take=self.take,
                    frame=int(broken[0, 0]),
                )

    def schedule(self, steps: int, dt: float) -> tuple[dict[int, list[tuple[int, float]]], int]:
        """Which frames enter when step k of ``steps`` steps of ``dt`` (s) is done: {k: [(frame,
        share of the step), …]}.

        A frame at t_k has share 1 of the step that ends there, one at the start of the motion share
        1 of k = 0. Also the number of frames before the start or after the end of the motion, which
        are left out.
        """
        position = np.round(self.t / dt, SHARE_DIGITS)
        inside = (position >= 0) & (position <= steps)
        due = defaultdict(list)
        for frame in np.flatnonzero(inside):
            k = int(np.ceil(position[frame]))
            due[k].append((int(frame), float(position[frame]) - k + 1))
        return dict(due), int(np.sum(~inside))

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
        """(F, d, d) lower triangular inverses W of the Cholesky factors of R, and (F,) logarithms c
        of the normal density's constant.

        So ln p(y_j | q) = c_j − ‖W_j(y_j − b_j − q)‖²/2 for a pose q at the time of frame j, or
        with the displacement of the tip in the place of y_j − b_j − q. Raises ModelDomainError for
        an R that is no covariance.
        """
        variances = np.linalg.eigvalsh(self.covariance)
        singular = variances[:, 0] <= SINGULAR_VARIANCE * variances[:, -1]
        if singular.any():
            raise ModelDomainError(
                "the covariance of the measurement's noise is not positive definite; estimate "
                "it from more takes than joints",
                take=self.take,
                frame=int(np.argmax(singular)),
            )
        factor = np.linalg.cholesky(self.covariance)
        log_determinant = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        return np.linalg.inv(factor), -log_determinant - 0.5 * factor.shape[-1] * np.log(2 * np.pi)


def measurements(angles: pd.DataFrame, noise: pd.DataFrame) -> list[Measurements]:
    """The depth camera's measurements of every take, each with the noise estimated without that
    take, from the tables ``angles`` and ``kinect_noise``.
    """
    names, takes = members(angles, "q"), []
    for take, rows in angles.groupby("take"):
        others = noise[noise["take"] == take].set_index("frame")
        # a frame at which no other take has one has no noise estimate to go with
        rows = rows[rows["frame"].isin(others.index)]
        others = others.loc[rows["frame"]]
        covariance = matrices(others, "r", names)
        time, q, bias = rows["t"].to_numpy(), values(rows, "q"), values(others, "b")
        takes.append(Measurements(str(take), time, q, bias, covariance))
    return takes
