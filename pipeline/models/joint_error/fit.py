"""Options and estimator of the joint error law."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from pipeline.core import validation
from pipeline.core.errors import ModelDomainError
from pipeline.models import steps as base
from pipeline.models.joint_error.law import (
    GROWTH,
    INPUTS,
    SATURATING,
    JointErrorModel,
    drive,
)
from pipeline.models.joint_error.samples import JointRun
from pipeline.models.joint_error.search import fit_one, joint_samples
from pipeline.models.steps import Estimate, Recorded, Truth

# options of pipeline/conf/model that a run compares, the simplest first
FAMILY = ("joint_step", "joint_step_t", "joint_error_normal", "joint_error")


@validation.options(kw_only=True)
class Options(base.Options):
    """``memory``: False if the error persists; ``power`` p of the growth of the variance with the
    commanded speed, or ``saturating``; ``tails``: ``normal`` or ``student``.
    """

    memory: bool
    power: Literal["saturating", "0", "1", "2"]
    tails: Literal["normal", "student"]

    def law(self) -> dict[str, Any]:
        """Return the arguments of :func:`fit_joint_error`."""
        power = self.power if self.power == SATURATING else float(self.power)
        return {"memory": self.memory, "power": power, "tails": self.tails == "student"}


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """Fit the law to the takes of ``recorded``; raises as :func:`fit_joint_error`."""
    law = fit_joint_error(runs_of(recorded), **options.law())
    values = {}
    for j, joint in enumerate(law.joints):
        dq = np.zeros(len(law.joints))
        dq[j] = law.reach[j] / law.rate
        for name, step in (("at_rest", np.zeros_like(dq)), ("at_greatest_speed", dq)):
            std = float(np.sqrt(law.covariance_of_joint_step(step)[j, j]))
            values[f"innovation_std_{name}_{joint}_rad"] = std
    return Estimate(law.parameters(), values, {})


def truths(
    recorded: Recorded, options: Options, dispersions: Sequence[float]
) -> list[Truth]:
    """Return the parameters fitted to ``recorded`` as the known ones."""
    known = estimate(recorded, options)
    return [Truth("joint error", known.parameters, known.estimates)]


def runs_of(recorded: Recorded) -> list[JointRun]:
    """Return the takes of ``recorded`` as runs of one motion. The commanded angles start at the
    mean of the first poses and follow the nominal steps of the command. Raises ModelDomainError
    without a rate.
    """
    if recorded.rate is None:
        raise ModelDomainError(
            "the joint error law needs the rate of the recorded steps"
        )
    poses, chain = recorded.poses, recorded.chain
    command = np.empty_like(poses)
    command[:, 0] = poses[:, 0].mean(axis=0)
    for k in range(command.shape[1] - 1):
        v = recorded.v[..., k, :]
        command[:, k + 1] = command[:, k] + chain.nominal_step(command[:, k], v)
    noise = recorded.known_measurement
    pose_noise = (
        None if noise is None else float(np.sqrt(np.trace(noise) / 2 / len(noise)))
    )
    zero, rate, joints = np.zeros(poses.shape[-1]), recorded.rate, recorded.joints
    return [
        JointRun(f"take {number}", rate, *angles, joints, zero, zero, pose_noise, "1")
        for number, angles in enumerate(zip(command, poses, strict=True), 1)
    ]


def fit_joint_error(
    runs: Sequence[JointRun],
    *,
    memory: bool = True,
    power: float | str = SATURATING,
    tails: bool = True,
) -> JointErrorModel:
    """Fit the law to ``runs`` of one arm at one rate. Without ``memory`` the error persists and
    only one sample ahead counts; ``tails`` fits Student's t. Raises ModelDomainError without
    errors.
    """
    if not runs or not any(np.any(run.measured != run.command) for run in runs):
        message = (
            "the measured angles equal the commanded ones; name the signals of each"
        )
        raise ModelDomainError(message, runs=len(runs))
    rate, inputs = runs[0].rate, [drive(run.command, run.rate, power) for run in runs]
    reach = np.max(
        [np.abs(np.diff(run.command, axis=0)).max(axis=0, initial=0) for run in runs], 0
    )
    quantum, laws = np.max([run.quantum for run in runs], axis=0), []
    for j, joint in enumerate(runs[0].joints):
        persistent = {
            "memory": np.array([[1.0, 0.0, 0.0]]),
            "mean_gain": np.zeros((1, len(INPUTS))),
            "scale": np.zeros((1, len(GROWTH))),
            "drift": np.zeros(1),
            "degrees": np.full(1, np.inf),
            "reach": reach[[j]] * rate,
            "quantum": quantum[[j]],
        }
        law = JointErrorModel((joint,), rate, **persistent, power=power)
        laws.append(fit_one(law, joint_samples(runs, inputs, j, memory), memory, tails))
    fitted = {
        name: np.concatenate([getattr(law, name) for law in laws])
        for name in persistent
    }
    return replace(laws[0], joints=runs[0].joints, **fitted)
