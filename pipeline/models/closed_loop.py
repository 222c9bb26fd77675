"""The closed loop: the commands of an arm that corrects a share of what it is off its path.

Closed-loop inverse kinematics (Siciliano et al., Robotics, 2009, Sec. 3.7): in place of v a model's
law takes the command

    v_k + κ(x*_k − x(q_k)),    κ = KΔt ∈ [0, 1],

x* the path that the arm is held to, a difference of poses being what takes one to the other. Open
loop, the paper's form, is κ = 0. The path is that of the training takes' mean q̄, x*_k = x(q̄_k),
and v_k = J(q̄_k)(q̄_{k+1} − q̄_k): without noise a model whose mean step is the nominal one then
stays on q̄. With more joints than task rows the step of q̄ is commanded in the null space too,
where the loop corrects nothing. The commanded path x^d is another: the arm's lag and the zeros of
its encoders lie between them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.models import kinds
from pipeline.models.model import Commands, MotionModel
from pipeline.models.steps import Recorded

FOLDER, SHARE = "closed", "closed_loop_share"  # beside the open loop's parameters; κ among them


@dataclass(frozen=True)
class MeanPath:
    """The mean of the training takes, which the closed loop holds the arm to."""

    chain: Chain
    poses: np.ndarray  # (M+1, n) q̄ in rad

    @cached_property
    def v(self) -> np.ndarray:
        """(M, m) J(q̄_k)(q̄_{k+1} − q̄_k), with q̄_{k+1} − q̄_k beside it (M, m + n) for n > m."""
        step = np.diff(self.poses, axis=0)
        v = np.matvec(self.chain.jacobian(self.poses[:-1]), step)
        return v if v.shape == step.shape else np.concatenate([v, step], axis=-1)

    @property
    def path(self) -> np.ndarray:
        """(M, p) x* before each step."""
        return self.chain.pose(self.poses[:-1])

    def corrected(self, q: np.ndarray, share: float) -> np.ndarray:
        """(takes, M, ·) the commands at ``q`` (takes, M, n) in rad of the loop of ``share`` κ."""
        m = len(self.chain.task)
        v = np.tile(self.v, (len(q), 1, 1))
        v[..., :m] += share * self.chain.displacement(self.chain.pose(q), self.path)
        return v

    def commands(self, share: float) -> Commands:
        """Commands of the closed loop of this ``share`` κ."""
        return Commands(self.v, self.path, share)


def measured_poses(recorded: Recorded) -> np.ndarray:
    """(takes, M+1, n) rad, the poses before and after the steps of ``recorded``."""
    return np.concatenate([recorded.q, recorded.q_next[:, -1:]], axis=1)


def mean_path(recorded: Recorded) -> MeanPath:
    """Mean path of the takes of ``recorded``."""
    return MeanPath(recorded.chain, measured_poses(recorded).mean(axis=0))


def closed_loop_steps(recorded: Recorded, path: MeanPath, share: float) -> Recorded:
    """The steps of ``recorded`` as the closed loop of ``share`` κ commanded them: v, of each take,
    with what it corrected, and the noise left.

    The correction is that of the measured deviation. Where the arm was commanded to rest the
    estimators are to see a rest, so v is zero there; the noise is not, and holds the correction.
    Raises ModelDomainError where the measurement's noise is not known.
    """
    chain, q = recorded.chain, recorded.q
    chain.require_regular(q, what="measured pose")
    v = path.corrected(q, share)
    noise = recorded.q_next - q - chain.nominal_step(q, v)
    v[:, ~np.any(recorded.v, axis=-1)] = 0.0
    measurement = closed_measurement(recorded, path, share)
    return replace(recorded, v=v, noise=noise, known_measurement=measurement)


def closed_measurement(recorded: Recorded, path: MeanPath, share: float) -> np.ndarray:
    """(n, n) in rad² of the measurement's noise in a step of the closed loop of ``share`` κ,
    n_{k+1} − (I − κJ⁺J)n_k, where an open one's, Σ_m, is of n_{k+1} − n_k: the mean over the
    ``path``.

    Of as many joints as task rows that is (1 + (1 − κ)²)/2·Σ_m at every step. Raises
    ModelDomainError where Σ_m is not known.
    """
    chain, q, each = recorded.chain, path.poses[:-1], recorded.measurement / 2
    if len(chain.task) == q.shape[-1]:
        return (1 + (1 - share) ** 2) * each
    kept = np.eye(q.shape[-1]) - share * (chain.inverse_jacobian(q) @ chain.jacobian(q))
    return each + (kept @ each @ np.swapaxes(kept, -1, -2)).mean(axis=0)


def fitted_closed_loop(folder: Path) -> tuple[MotionModel, float] | None:
    """The model and κ of the closed loop whose fit stands in ``folder``; None where there is none.

    Raises what :func:`pipeline.models.kinds.fitted_model` does.
    """
    closed = folder / FOLDER
    if not closed.is_dir():
        return None
    return kinds.fitted_model(closed), json.loads((closed / "parameters.json").read_text())[SHARE]
