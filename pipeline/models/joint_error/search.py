"""Fit of the joint error law to runs, by a composite likelihood of three horizons: one sample,
0.1 s and 0.5 s. The likelihood of one sample alone weighs the fast part of the error and is
overconfident half a second ahead.

The memory (φ, ψ, χ) is the least-squares regression of r on its past. The gains β of the mean are
a ridge regression at the three horizons. Its penalty has the least squared error on held-out
motions, or on held-out quarters of the runs of a single motion; an infinite penalty removes the
mean. Scale, tails and drift maximise the composite likelihood of the held-out residuals. Only
commanded steps count that are not within :data:`SETTLING` s of a jump of the commanded speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Literal

import numpy as np
from numpy import ndarray

from pipeline.models.joint_error.law import (
    INPUTS,
    Drive,
    JointErrorModel,
    past_of,
    unit_variance_factor,
)
from pipeline.models.joint_error.likelihood import composite_loss, damped_memory
from pipeline.models.joint_error.samples import JointRun, horizon_samples

Memory = Literal["none", "persistent", "autoregressive", "full"]
PENALTIES = (1e-3, 1e-2, 1e-1, 1.0, 10.0, np.inf)  # of the ridge regression, relative
MOST = (2000, 1000, 500)  # samples by horizon in the composite likelihood
DEGREES = (4.0, 50.0)  # bounds of ν: σ exists and ±σ holds less than .78
FIRST, LAST = 20, 60  # iterations of the searches before and after the mean
ROUNDS = 2  # of memory and likelihood, mean
LEAST = 20  # commanded samples of a joint that determine its law


@dataclass(frozen=True)
class JointSamples:
    """Runs of one joint one after the other."""

    error: ndarray  # (N,) rad
    inputs: Drive  # (N, …) of this joint
    pieces: list[slice]  # of one run and one held-out group
    groups: ndarray  # (N,) number of the part that is held out with a sample
    one: ndarray  # all samples before a prediction of one sample that counts
    # steps ahead → samples before the predictions that count, at most about 2·MOST by horizon
    before: dict[int, ndarray]


def joint_samples(
    law: JointErrorModel, runs: Sequence[JointRun], j: int, memory: Memory
) -> JointSamples:
    """Return the samples of joint ``j`` of the ``runs`` with the inputs of its ``law``; without
    full ``memory`` only predictions one sample ahead.
    """
    lengths = [len(run.command) for run in runs]
    starts, chosen = np.cumsum([0, *lengths[:-1]]), {}
    error = np.concatenate([run.measured[:, j] - run.command[:, j] for run in runs])
    inputs = [law.inputs(run.command[:, [j]]) for run in runs]
    together = Drive(
        *(np.concatenate([each[k][:, 0] for each in inputs]) for k in range(2))
    )
    motions = sorted({run.motion for run in runs})
    # the held-out part of each sample: its motion, or quarter of the run
    groups = np.repeat([motions.index(run.motion) for run in runs], lengths)
    if len(motions) == 1:
        groups = np.concatenate([np.arange(count) * 4 // count for count in lengths])
    for steps in horizon_samples(runs[0].rate)[: 3 if memory == "full" else 1]:
        own = [np.flatnonzero(run.moving[steps:, j]) for run in runs]
        if sum(map(len, own)) < LEAST:  # a joint that stands still: all samples
            own = [np.arange(max(count - steps, 0)) for count in lengths]
        before = np.concatenate(
            [first + each for first, each in zip(starts, own, strict=True)]
        )
        inside = groups[before] == groups[before + steps]
        chosen[steps] = before[inside] if inside.any() else before
    thin = zip(chosen.items(), MOST, strict=False)  # 0.1 s may be one sample
    before = {steps: all_[:: max(1, len(all_) // most)] for (steps, all_), most in thin}
    borders = {0, len(groups), *starts, *(1 + np.flatnonzero(np.diff(groups)))}
    pieces = [slice(*each) for each in pairwise(sorted(map(int, borders)))]
    return JointSamples(
        error, together, pieces, groups, next(iter(chosen.values())), before
    )


def fit_one(
    law: JointErrorModel, joint: JointSamples, memory: Memory, tails: bool
) -> JointErrorModel:
    """Return the ``law`` of one joint, fitted to its samples."""
    size = float(np.sqrt(np.mean(joint.error**2))) or 1e-9
    if memory != "full":
        past = _past(law, joint, joint.error)
        if memory == "none":
            law = replace(law, memory=np.zeros((1, 3)))
        if memory == "autoregressive":
            law = replace(law, memory=_second_order(law, joint, past)[None])
        return _likelihood(law, joint, joint.error, past, None, size, tails, None)[0]
    theta, held = None, joint.error
    for round_ in range(ROUNDS):
        past = _past(law, joint, held)
        values = _regression(joint, held, past)
        law, theta = _likelihood(law, joint, held, past, values, size, tails, theta)
        if round_ < ROUNDS - 1:
            gain, held = _mean(law, joint, size)
            law = replace(law, mean_gain=gain[None])
    return law


def _second_order(law: JointErrorModel, joint: JointSamples, past: ndarray) -> ndarray:
    """(3,) φ, ψ and 0 of an autoregression of order two, by least squares of one sample."""
    memory = np.zeros(3)
    memory[:2] = _regression(joint, joint.error, past[:, :2])[0]
    return damped_memory(memory, 1.0, law.keep)


def _past(own: JointErrorModel, joint: JointSamples, r: ndarray) -> ndarray:
    """(N, 3, …) r, previous r and z of residuals or inputs ``r`` (N, …), piece by piece."""
    return np.concatenate(
        [np.moveaxis(past_of(r[p], own.keep), -1, 1) for p in joint.pieces]
    )


def _regression(
    joint: JointSamples, r: ndarray, past: ndarray
) -> tuple[ndarray, ndarray]:
    """Return the coefficients (p,) of the ``past`` (N, p) by least squares of one sample, φ, ψ and
    χ, and a root (p, p) of their covariance.
    """
    a, y = past[joint.one], r[joint.one + 1]
    moment = a.T @ a
    moment += np.diag(1e-9 * np.diag(moment) + 1e-300)
    values = np.linalg.solve(moment, a.T @ y)
    error = np.mean((y - a @ values) ** 2) + 1e-300
    return values, np.linalg.cholesky(np.linalg.inv(moment / len(y) / error))


def _likelihood(
    own, joint: JointSamples, r, past, values, size: float, tails: bool, start
):
    """Return the law with the most likely scale, drift, tails and damping of the memory ``values``
    (None: none), and the search's result.
    """
    from scipy.optimize import minimize

    growth, bases = joint.inputs.growth, own.scale.shape[1]
    counts = np.array([len(each) for each in joint.before.values()])
    ends = [before + steps for steps, before in joint.before.items()]
    horizons, ends = np.array([*joint.before]), np.concatenate(ends)

    def parameters(theta: ndarray) -> tuple[ndarray, ndarray, float, float]:
        """Return memory, scale / size², drift and degrees."""
        scale = np.exp(2 * theta[:bases])
        degrees = DEGREES[0] + np.exp(theta[bases]) if tails else np.inf
        if values is None:
            return own.memory[0], scale, 0.0, degrees
        drift = 1 / (1 + np.exp(-theta[bases + 1]))
        shifted = values[0] + values[1] @ theta[bases + 3 :]
        memory = damped_memory(shifted, 1 - np.exp(theta[bases + 2]), own.keep)
        return memory, scale, drift, degrees

    floor = 1e-14 + float(own.quantum[0] / size) ** 2 / 12
    data = (r / size, past / size, growth, horizons, ends, counts, floor)

    def loss(theta: ndarray) -> float:
        return composite_loss(*parameters(theta), own.keep, own.persistence, *data)

    steps, before = next(iter(joint.before.items()))
    first = past[before] @ (own.memory[0] if values is None else values[0])
    rms = np.log(
        max(float(np.sqrt(np.mean((r[before + steps] - first) ** 2))) / size, 1e-6)
    )
    rounds = FIRST if start is None and values is not None else LAST
    if start is None:
        mean = [typical_growth(column) for column in growth[before + steps].T]
        start = np.r_[
            rms - 0.7 - np.log(mean) / 2, np.log(4.0), -4.0, -7.0, np.zeros(3)
        ]
    bounds = [(rms - 7, rms + 7)] * bases + [(-6.0, np.log(DEGREES[1] - DEGREES[0]))]
    bounds += [(-9.0, 4.0), (-14.0, -1.5), *[(-3.0, 3.0)] * 3]
    start = np.clip(start, *np.array(bounds).T)
    search = {"maxiter": rounds, "ftol": 1e-6}
    found = minimize(loss, start, method="L-BFGS-B", bounds=bounds, options=search).x
    memory, scale, drift, degrees = parameters(found)
    best = {
        "memory": memory,
        "scale": np.where(growth.any(axis=0), scale * size**2, 0.0),
        "drift": drift,
        "degrees": degrees,
    }
    return replace(
        own, **{name: np.array([each]) for name, each in best.items()}
    ), found


def typical_growth(column: ndarray) -> float:
    """Return the mean of a factor of the scale over the samples at which it is not 0."""
    active = column[column > 1e-6 * column.max(initial=0.0)]
    return float(active.mean()) if len(active) else 1.0


def _mean(
    own: JointErrorModel, joint: JointSamples, size: float
) -> tuple[ndarray, ndarray]:
    """Return β, and the residuals (N,) of the errors under a β fitted without their group."""
    weights, impulse = own.response([*joint.before][-1])
    x = joint.inputs.mean
    unit = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    x = x / unit
    past_e, past_x = _past(own, joint, joint.error), _past(own, joint, x)
    std = np.sqrt(joint.inputs.growth @ own.scale[0])[:, None]
    factor, nu = unit_variance_factor(own.degrees)[0], own.degrees[0]
    numbers = np.unique(joint.groups)
    normal = {g: [0.0, 0.0, 0.0] for g in numbers}
    for steps, before in joint.before.items():
        row, end = weights[steps - 1, 0], before + steps
        u = joint.error[end] - past_e[before] @ row
        a = x[end] - np.einsum("kif,i->kf", past_x[before], row)
        variance = own.variance(std, end, steps, impulse)[:, 0] + 1e-14 * size**2
        weight = 1 / variance
        if np.isfinite(nu):
            weight = weight * (nu + 1) / (nu + u**2 / (variance * factor))
        for g in numbers:
            inside = joint.groups[end] == g
            w, v, b = weight[inside], u[inside], a[inside]
            parts = (b.T * w) @ b, (b.T * w) @ v, float(w @ v**2)
            normal[g] = [old + new for old, new in zip(normal[g], parts, strict=True)]
    total = [sum(normal[g][i] for g in numbers) for i in range(2)]

    # of all groups: inputs that a fold lacks have no gain in it
    size_of_input = np.diag(total[0]) + 1e-12 * np.trace(total[0]) + 1e-300

    def ridge(moment: ndarray, across: ndarray, penalty: ndarray) -> ndarray:
        used = np.isfinite(penalty)
        gains = np.zeros(len(across))
        if used.any():
            penalised = np.diag(penalty[used] * size_of_input[used])
            moment = moment[np.ix_(used, used)] + penalised
            gains[used] = np.linalg.solve(moment, across[used])
        return gains

    best = (np.inf, np.inf, {})
    jumped = np.array([name.endswith("jumps") for name in INPUTS])
    for smooth, jump in product(
        PENALTIES, PENALTIES if x[:, jumped].any() else PENALTIES[-1:]
    ):
        penalty = np.where(jumped, jump, smooth)
        gains, loss = {}, 0.0
        for g in numbers:
            gains[g] = ridge(total[0] - normal[g][0], total[1] - normal[g][1], penalty)
            moment, across, square = normal[g]
            loss += square - 2 * across @ gains[g] + gains[g] @ moment @ gains[g]
        if loss <= best[0]:
            best = (loss, penalty, gains)
    held = np.array([best[2][g] for g in joint.groups])
    return ridge(*total, best[1]) / unit, joint.error - np.einsum("kf,kf->k", x, held)
