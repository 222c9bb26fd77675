"""Fit of the joint error law to runs, by a composite likelihood of three horizons: one sample,
0.1 s and 0.5 s. The likelihood of one sample alone weighs the fast part of the error and is
overconfident half a second ahead.

The memory (φ, ψ, χ) is the least-squares regression of r on its past. The gains β of the mean are
a ridge regression at the three horizons. Its penalty has the least squared error on held-out
motions, or on held-out quarters of the runs of a single motion; an infinite penalty removes the
mean. Scale, tails and drift maximise the composite likelihood of the held-out residuals. Only
commanded steps count that are not within :data:`SETTLING` s of a jump of the commanded speed.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy import ndarray

from pipeline.models.joint_error.law import (
    Drive,
    JointErrorModel,
    past_of,
    unit_variance_factor,
)
from pipeline.models.joint_error.likelihood import composite_loss, damped_memory

PENALTIES = (1e-3, 1e-2, 1e-1, 1.0, 10.0, np.inf)  # of the ridge regression, relative
MOST = (2000, 1000, 500)  # samples by horizon in the composite likelihood
DEGREES = (4.0, 50.0)  # bounds of ν: σ exists and ±σ holds less than .78
FIRST, LAST = 20, 60  # iterations of the searches before and after the mean
ROUNDS = 2  # of memory and likelihood, mean
LEAST = 20  # commanded samples of a joint that determine its law


@dataclass(frozen=True)
class Sample:
    """Predictions of one joint ``steps`` ahead that count: sample before and at the end, of all
    runs one after the other.
    """

    steps: int
    before: ndarray
    end: ndarray


@dataclass(frozen=True)
class JointSamples:
    """Runs of one joint one after the other."""

    error: ndarray  # (N,) rad
    inputs: Drive  # (N, …) of this joint
    pieces: list[slice]  # of one run and one held-out group
    groups: ndarray  # (N,) number of the part that is held out with a sample
    one: ndarray  # all samples before a prediction of one sample that counts
    samples: list[Sample]  # at most about 2·MOST by horizon


def joint_of(runs, inputs, masks, groups, j: int, memory: bool) -> JointSamples:
    starts = np.cumsum([0, *(len(run.command) for run in runs[:-1])])
    error = np.concatenate([run.measured[:, j] - run.command[:, j] for run in runs])
    together = Drive(*(np.concatenate([each[k][:, j] for each in inputs]) for k in range(2)))
    samples, one, groups = [], None, np.concatenate(groups)
    for most, (steps, mask) in zip(MOST, masks.items(), strict=False):  # 0.1 s may be one sample
        before = np.concatenate(
            [first + np.flatnonzero(own[:, j]) for first, own in zip(starts, mask, strict=True)]
        )
        if len(before) < LEAST:  # a joint that stands still: all samples
            lengths = [len(run.command) - steps for run in runs]
            each = zip(starts, lengths, strict=True)
            before = np.concatenate([first + np.arange(max(count, 0)) for first, count in each])
        inside = groups[before] == groups[before + steps]
        before = before[inside if inside.any() else slice(None)]
        one = before if one is None else one
        before = before[:: max(1, len(before) // most)]
        samples.append(Sample(steps, before, before + steps))
    borders = {0, len(groups), *starts, *(1 + np.flatnonzero(np.diff(groups)))}
    pieces = [slice(*each) for each in pairwise(sorted(int(border) for border in borders))]
    return JointSamples(error, together, pieces, groups, one, samples[: 3 if memory else 1])


def _one(law: JointErrorModel, j: int) -> JointErrorModel:
    """Return the law of joint ``j`` alone."""
    arrays = ("memory", "mean_gain", "scale", "drift", "degrees", "reach", "quantum")
    each = {name: getattr(law, name)[[j]] for name in arrays}
    return replace(law, joints=(law.joints[j],), **each)


def fit_one(law: JointErrorModel, joint: JointSamples, j: int, memory: bool, tails: bool):
    own = _one(law, j)
    size = float(np.sqrt(np.mean(joint.error**2))) or 1e-9
    theta, held = None, joint.error
    for round_ in range(ROUNDS if memory else 1):
        past = _past(own, joint, held)
        values = _regression(joint, held, past) if memory else None
        own, theta = _likelihood(own, joint, held, past, values, size, tails, theta)
        if memory and round_ < ROUNDS - 1:
            gain, held = _mean(own, joint, size)
            own = replace(own, mean_gain=gain[None])
    changed = {}
    for name in ("memory", "mean_gain", "scale", "drift", "degrees"):
        changed[name] = getattr(law, name).copy()
        changed[name][j] = getattr(own, name)[0]
    return replace(law, **changed)


def _past(own: JointErrorModel, joint: JointSamples, r: ndarray) -> ndarray:
    """(N, 3, …) r, previous r and z of residuals or inputs ``r`` (N, …), piece by piece."""
    parts = []
    for piece in joint.pieces:
        parts.append(np.moveaxis(past_of(r[piece], own.keep), -1, 1))
    return np.concatenate(parts)


def _regression(joint: JointSamples, r: ndarray, past: ndarray) -> tuple[ndarray, ndarray]:
    """(3,) φ, ψ, χ by least squares of one sample."""
    a, y = past[joint.one], r[joint.one + 1]
    moment = a.T @ a
    moment += np.diag(1e-9 * np.diag(moment) + 1e-300)
    values = np.linalg.solve(moment, a.T @ y)
    error = np.mean((y - a @ values) ** 2) + 1e-300
    return values, np.linalg.cholesky(np.linalg.inv(moment / len(y) / error))


def _likelihood(own, joint: JointSamples, r, past, values, size: float, tails: bool, start):
    """Return the law with the most likely scale, drift, tails and damping of the memory ``values``
    (None: none), and the search's result.
    """
    from scipy.optimize import minimize

    growth, bases = joint.inputs.growth, own.scale.shape[1]
    horizons = np.array([each.steps for each in joint.samples])
    counts = np.array([len(each.end) for each in joint.samples])
    ends = np.concatenate([each.end for each in joint.samples])

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

    one = joint.samples[0]
    first = past[one.before] @ (own.memory[0] if values is None else values[0])
    rms = np.log(max(float(np.sqrt(np.mean((r[one.end] - first) ** 2))) / size, 1e-6))
    rounds = FIRST if start is None and values is not None else LAST
    if start is None:
        mean = np.maximum(growth[one.end].mean(axis=0), 1e-6)
        start = np.r_[rms - 0.7 - np.log(mean) / 2, np.log(4.0), -4.0, -7.0, np.zeros(3)]
    bounds = [(rms - 7, rms + 7)] * bases
    bounds += [
        (-6.0, np.log(DEGREES[1] - DEGREES[0])),
        (-9.0, 4.0),
        (-14.0, -1.5),
        *[(-3.0, 3.0)] * 3,
    ]
    start = np.clip(start, *np.array(bounds).T)
    search = {"maxiter": rounds, "ftol": 1e-6}
    found = minimize(loss, start, method="L-BFGS-B", bounds=bounds, options=search).x
    memory, scale, drift, degrees = parameters(found)
    best = {"memory": memory, "scale": scale * size**2, "drift": drift, "degrees": degrees}
    return replace(own, **{name: np.array([each]) for name, each in best.items()}), found


def _mean(own: JointErrorModel, joint: JointSamples, size: float) -> tuple[ndarray, ndarray]:
    """Return β, and the residuals (N,) of the errors under a β fitted without their group."""
    weights, impulse = own.response(joint.samples[-1].steps)
    x = joint.inputs.mean
    unit = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    x = x / unit
    past_e, past_x = _past(own, joint, joint.error), _past(own, joint, x)
    std = np.sqrt(joint.inputs.growth @ own.scale[0])[:, None]
    factor, nu = unit_variance_factor(own.degrees)[0], own.degrees[0]
    numbers = np.unique(joint.groups)
    normal = {g: [0.0, 0.0, 0.0] for g in numbers}
    for each in joint.samples:
        row = weights[each.steps - 1, 0]
        u = joint.error[each.end] - past_e[each.before] @ row
        a = x[each.end] - np.einsum("kif,i->kf", past_x[each.before], row)
        variance = own.variance(std, each.end, each.steps, impulse)[:, 0] + 1e-14 * size**2
        weight = 1 / variance
        if np.isfinite(nu):
            weight = weight * (nu + 1) / (nu + u**2 / (variance * factor))
        for g in numbers:
            inside = joint.groups[each.end] == g
            w, v, b = weight[inside], u[inside], a[inside]
            parts = (b.T * w) @ b, (b.T * w) @ v, float(w @ v**2)
            normal[g] = [old + new for old, new in zip(normal[g], parts, strict=True)]
    total = [sum(normal[g][i] for g in numbers) for i in range(2)]

    def ridge(moment: ndarray, across: ndarray, penalty: float) -> ndarray:
        if np.isinf(penalty):
            return np.zeros(len(across))
        least = 1e-6 * np.diag(total[0]) + 1e-12 * np.trace(total[0]) + 1e-300
        return np.linalg.solve(moment + penalty * np.diag(np.diag(moment) + least), across)

    best = (np.inf, np.inf, {})
    for penalty in PENALTIES:
        gains, loss = {}, 0.0
        for g in numbers:
            gains[g] = ridge(total[0] - normal[g][0], total[1] - normal[g][1], penalty)
            moment, across, square = normal[g]
            loss += square - 2 * across @ gains[g] + gains[g] @ moment @ gains[g]
        if loss <= best[0]:
            best = (loss, penalty, gains)
    held = np.array([best[2][g] for g in joint.groups])
    gain = ridge(*total, best[1]) / unit
    return gain, joint.error - np.einsum("kf,kf->k", x, held)
