"""Options and estimator of the joint error law."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from pipeline.core import validation
from pipeline.core.errors import ModelDomainError
from pipeline.models import steps as base
from pipeline.models.joint_error.drive import GROWTH, INPUTS, JUMPS, SATURATING
from pipeline.models.joint_error.law import JointErrorModel
from pipeline.models.joint_error.samples import (
    JointRun,
    jump_threshold,
    lags_of_logs,
    lasting_speeds,
)
from pipeline.models.joint_error.search import (
    JUMP_INPUTS,
    LEAST,
    JointSamples,
    Memory,
    fit_joint,
    joint_samples,
)
from pipeline.models.steps import Estimate, Recorded, Truth

# options of pipeline/conf/model that a run compares, the simplest first
FAMILY = (
    "joint_constant",
    "joint_step",
    "joint_step_t",
    "joint_autoregression",
    "joint_error_normal",
    "joint_error",
)


@validation.options(kw_only=True)
class Options(base.Options):
    """``memory``: ``none`` if errors are independent of the past, ``persistent`` if an error stays
    until the next step, ``autoregressive`` of order two, or ``full``; ``power`` p of the growth of
    the variance with the commanded speed, or ``saturating``; ``tails``: ``normal`` or ``student``.
    """

    memory: Memory
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
        speeds = {"at_rest": 0.0, "at_greatest_speed": law.reach[j]}
        step = np.zeros(len(law.joints))
        for name, speed in speeds.items():
            step[j] = speed / law.rate
            covariance = law.covariance_of_joint_step(step)
            std = np.sqrt(covariance[j, j])
            values[f"innovation_std_{name}_{joint}_rad"] = float(std)
    return Estimate(law.parameters(), values, {})


def truths(
    recorded: Recorded,
    options: Options,
    dispersions: Sequence[float],
) -> list[Truth]:
    """Return the parameters fitted to ``recorded`` as the known ones."""
    fitted = estimate(recorded, options)
    return [Truth("joint error", fitted.parameters, fitted.estimates)]


def runs_of(recorded: Recorded) -> list[JointRun]:
    """Return the takes of ``recorded`` as runs of one motion. The commanded angles start at the
    mean of the first poses and follow the nominal steps of the command. Raises ModelDomainError
    without a rate.
    """
    if recorded.rate is None:
        raise ModelDomainError(
            "the joint error law needs the rate of the recorded steps",
        )
    poses = recorded.poses
    chain = recorded.chain
    command = np.empty_like(poses)
    command[:, 0] = poses[:, 0].mean(axis=0)
    for k in range(command.shape[1] - 1):
        v = recorded.v[..., k, :]
        command[:, k + 1] = command[:, k] + chain.nominal_step(command[:, k], v)
    pose_noise = None
    if (noise := recorded.known_measurement) is not None:
        pose_noise = float(np.sqrt(np.trace(noise) / 2 / len(noise)))
    zero = np.zeros(poses.shape[-1])
    runs = []
    for number in range(len(poses)):
        run = JointRun(
            name=f"take {number + 1}",
            rate=recorded.rate,
            command=command[number],
            measured=poses[number],
            joints=recorded.joints,
            lag=zero,
            quantum=zero,
            pose_noise=pose_noise,
            motion="1",
        )
        runs.append(run)
    return runs


def fit_joint_error(
    runs: Sequence[JointRun],
    *,
    memory: Memory = "full",
    power: float | str = SATURATING,
    tails: bool = True,
) -> JointErrorModel:
    """Fit the law to ``runs`` of one arm at one rate. Only the ``full`` memory is fitted to three
    horizons, the others to one sample ahead; ``tails`` fits Student's t. A joint with fewer than
    LEAST samples after a jump of its speed has there the :func:`mean_jump_variance` of the other
    joints. Raises ModelDomainError without errors.
    """
    if not runs or not any(np.any(run.measured != run.command) for run in runs):
        message = (
            "the measured angles equal the commanded ones; name the signals of each"
        )
        raise ModelDomainError(message, runs=len(runs))
    unfitted = unfitted_law(runs, power)
    laws = []
    few = []
    jumping = []
    for j in range(len(unfitted.joints)):
        law = unfitted.of_joint(j)
        samples = joint_samples(law, runs, j, memory)
        laws.append(fit_joint(law, samples, memory, tails))
        if np.count_nonzero(samples.inputs.growth[:, JUMPS]) < LEAST:
            few.append(j)
        else:
            jumping.append((j, samples))
    fitted = {}
    for name in ("memory", "mean_gain", "scale", "drift", "degrees"):
        fitted[name] = np.concatenate([getattr(law, name) for law in laws])
    law = replace(unfitted, **fitted)
    if few and jumping:
        law.scale[few, JUMPS] = mean_jump_variance(law, jumping, memory, tails)
    return law


def mean_jump_variance(
    law: JointErrorModel,
    jumping: Sequence[tuple[int, JointSamples]],
    memory: Memory,
    tails: bool,
) -> float:
    """Return the mean variance after a jump of the speed of the joints ``jumping`` (number and
    samples) of the fitted ``law``, without a mean response to jumps: a joint without jumps has no
    such response, and its errors after a jump have the whole size.
    """
    variances = []
    for j, samples in jumping:
        of_joint = law.of_joint(j)
        if of_joint.mean_gain[:, JUMP_INPUTS].any():
            without_mean = samples.without_jump_mean()
            of_joint = fit_joint(of_joint, without_mean, memory, tails)
        variances.append(of_joint.scale[0, JUMPS])
    return float(np.mean(variances))


def unfitted_law(runs: Sequence[JointRun], power: float | str) -> JointErrorModel:
    """Return the law of errors that persist without noise, with the ranges, steps of the angles and
    lags of ``runs``.
    """
    rate = runs[0].rate
    n = len(runs[0].joints)
    speeds = np.concatenate([lasting_speeds(run) for run in runs])
    lags = lags_of_logs(runs)
    lag_std = np.zeros(n)
    if len(lags) > 1:  # of one more run about the mean of these
        lag_std = lags.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(lags))
    return JointErrorModel(
        joints=runs[0].joints,
        rate=rate,
        memory=np.tile([1.0, 0.0, 0.0], (n, 1)),
        mean_gain=np.zeros((n, len(INPUTS))),
        scale=np.zeros((n, len(GROWTH))),
        drift=np.zeros(n),
        degrees=np.full(n, np.inf),
        reach=np.abs(speeds).max(axis=0),
        quantum=np.max([run.quantum for run in runs], axis=0),
        jump=jump_threshold([run.command for run in runs], rate),
        lag=lags.mean(axis=0),
        lag_std=lag_std,
        power=power,
    )
