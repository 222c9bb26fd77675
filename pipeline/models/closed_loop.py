"""The closed loop: the commands of an arm that corrects a share of what it is off its path.

Closed-loop inverse kinematics (Siciliano et al., Robotics, 2009, Sec. 3.7): in place of v a model's
law takes the command

    v_k + κ(x*_k − x(q_k)),    κ = KΔt ∈ [0, 1],

x* the path that the arm is held to. Open loop, the paper's form, is κ = 0. The path is that of the
training takes' mean q̄, x*_k = x(q̄_k), and v_k = J(q̄_k)(q̄_{k+1} − q̄_k): without noise a model
whose mean step is the nominal one then stays on q̄. The commanded path x^d is another: the arm's
lag and the zeros of its encoders lie between them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.models import kinds
from pipeline.models.commands import Commands
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded

FOLDER, SHARE = "closed", "closed_loop_share"  # beside the open loop's parameters; κ among them


@dataclass(frozen=True)
class MeanPath:
    """The mean of the training takes, which the closed loop holds the arm to."""

    chain: PlanarChain
    poses: np.ndarray  # (M+1, n) q̄ in rad

    @cached_property
    def v(self) -> np.ndarray:
        """(M, m) J(q̄_k)(q̄_{k+1} − q̄_k)."""
        return np.matvec(self.chain.jacobian(self.poses[:-1]), np.diff(self.poses, axis=0))

    def commands(self, share: float) -> Commands:
        """Of the closed loop of this ``share`` κ."""
        return Commands(self.v, self.chain.pose(self.poses[:-1]), share)


def measured_poses(recorded: Recorded) -> np.ndarray:
    """(takes, M+1, n) rad, the poses before and after the steps of ``recorded``."""
    return np.concatenate([recorded.q, recorded.q_next[:, -1:]], axis=1)


def mean_path(recorded: Recorded) -> MeanPath:
    """Of the takes of ``recorded``."""
    return MeanPath(recorded.chain, measured_poses(recorded).mean(axis=0))


def closed_loop_steps(recorded: Recorded, path: MeanPath, share: float) -> Recorded:
    """The steps of ``recorded`` as the closed loop of ``share`` κ commanded them: v (takes, M, m)
    with what it corrected, and the noise left.

    The correction is that of the measured deviation. Where the arm was commanded to rest the
    estimators are to see a rest, so v is zero there; the noise is not, and holds the correction.
    The measurement's noise n_{k+1} − (1 − κ)n_k of such a step has (1 + (1 − κ)²)/2 of the
    covariance of an open one's, n_{k+1} − n_k. Raises ModelDomainError where that is not known.
    """
    chain, q = recorded.chain, recorded.q
    v = path.v + share * (chain.pose(path.poses[:-1]) - chain.pose(q))
    noise = recorded.q_next - q - np.matvec(chain.inverse_jacobian(q, what="measured pose"), v)
    resting = ~np.any(recorded.v, axis=-1)
    v[:, resting] = 0.0
    measurement = (1 + (1 - share) ** 2) / 2 * recorded.measurement
    return replace(recorded, v=v, noise=noise, known_measurement=measurement)


def fitted_closed_loop(folder: Path) -> tuple[MotionModel, float] | None:
    """The model and κ of the closed loop whose fit stands in ``folder``; None where there is none.

    Raises what :func:`pipeline.models.kinds.fitted_model` does.
    """
    closed = folder / FOLDER
    if not closed.is_dir():
        return None
    return kinds.fitted_model(closed), json.loads((closed / "parameters.json").read_text())[SHARE]
