"""Fit of the joint error law to runs, by a composite likelihood of three horizons: one sample,
0.1 s and 0.5 s. The likelihood of one sample alone weighs the fast part of the error and is
overconfident half a second ahead.

The memory (φ, ψ, χ) is the least-squares regression of r on its past. The gains β of the mean are
a ridge regression at the three horizons. Its penalty has the least squared error on held-out
motions, held-out runs of the only motion whose speed jumps, or held-out quarters of the runs of a
single motion; an infinite penalty removes the mean. Scale, tails and drift maximise the composite
likelihood of the held-out residuals. Only commanded steps count.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Literal, NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.models.joint_error.drive import INPUTS, Drive
from pipeline.models.joint_error.law import JointErrorModel, past_of
from pipeline.models.joint_error.likelihood import (
    NoiseLaw,
    Residuals,
    composite_loss,
    damped_memory,
)
from pipeline.models.joint_error.outlook import unit_variance_factor
from pipeline.models.joint_error.samples import JointRun, horizon_samples

Memory = Literal["none", "persistent", "autoregressive", "full"]
PENALTIES = (1e-3, 1e-2, 1e-1, 1.0, 10.0, np.inf)  # of the ridge regression, relative
MOST = (2000, 1000, 500)  # samples by horizon in the composite likelihood
DEGREES = (4.0, 50.0)  # bounds of ν: σ exists and ±σ holds less than .78
# iterations of the searches before and after the mean
FIRST = 20
LAST = 60
ROUNDS = 2  # of memory and likelihood, mean
LEAST = 20  # commanded samples of a joint that determine its law
QUARTERS = 4  # parts of the runs of a single motion that are held out
JUMP_INPUTS = np.array([name.endswith("jumps") for name in INPUTS])


@dataclass(frozen=True)
class JointSamples:
    """Runs of one joint one after the other."""

    error: ndarray  # (N,) rad
    inputs: Drive  # (N, …) of this joint
    pieces: list[slice]  # of one run and one held-out group
    groups: ndarray  # (N,) number of the part that is held out with a sample
    first: ndarray  # all samples before a prediction of one sample that counts
    # steps ahead → samples before the predictions that count, at most about 2·MOST by horizon
    before: dict[int, ndarray]

    def without_jump_mean(self) -> "JointSamples":
        """Return the samples with a mean that does not respond to jumps of the speed."""
        mean = np.where(JUMP_INPUTS, 0.0, self.inputs.mean)
        return replace(self, inputs=self.inputs._replace(mean=mean))

    def past(self, law: JointErrorModel, r: ndarray) -> ndarray:
        """(N, 3, …) r, previous r and z of residuals or inputs ``r`` (N, …), piece by piece."""
        parts = [past_of(r[piece], law.keep) for piece in self.pieces]
        return np.moveaxis(np.concatenate(parts), -1, 1)


def joint_samples(
    law: JointErrorModel,
    runs: Sequence[JointRun],
    j: int,
    memory: Memory,
) -> JointSamples:
    """Return the samples of joint ``j`` of the ``runs`` with the inputs of its ``law``; without
    full ``memory`` only predictions one sample ahead.
    """
    inputs = [law.inputs(run.command[:, [j]]) for run in runs]
    groups = _held_out_groups(runs, inputs)
    horizons = horizon_samples(runs[0].rate)
    if memory != "full":
        horizons = horizons[:1]
    counted = {steps: _counted_samples(runs, j, steps, groups) for steps in horizons}
    before = {}
    for (steps, samples), most in zip(counted.items(), MOST, strict=False):
        before[steps] = samples[:: max(1, len(samples) // most)]
    return JointSamples(
        error=np.concatenate([run.measured[:, j] - run.command[:, j] for run in runs]),
        inputs=Drive(
            mean=np.concatenate([drive.mean[:, 0] for drive in inputs]),
            growth=np.concatenate([drive.growth[:, 0] for drive in inputs]),
        ),
        pieces=_pieces(runs, groups),
        groups=groups,
        first=counted[horizons[0]],
        before=before,
    )


def _held_out_groups(runs: Sequence[JointRun], inputs: Sequence[Drive]) -> ndarray:
    """(N,) number of the held-out part of each sample: its motion. A single motion is held out by
    quarters of its runs. The only motion with jumps of the joint's speed is held out by runs, so
    that other runs determine the response to a jump. ``inputs`` are those of the runs.
    """
    motions = sorted({run.motion for run in runs})
    jumping = set()
    for run, drive in zip(runs, inputs, strict=True):
        if drive.mean[..., JUMP_INPUTS].any():
            jumping.add(run.motion)
    parts = []
    for number, run in enumerate(runs):
        count = len(run.command)
        if len(motions) == 1:
            part = np.arange(count) * QUARTERS // count
        elif jumping == {run.motion}:
            part = np.full(count, len(motions) + number)
        else:
            part = np.full(count, motions.index(run.motion))
        parts.append(part)
    return np.concatenate(parts)


def _starts(runs: Sequence[JointRun]) -> ndarray:
    """(len(runs) + 1,) first sample of each run in the runs one after the other, and the end."""
    return np.cumsum([0, *(len(run.command) for run in runs)])


def _pieces(runs: Sequence[JointRun], groups: ndarray) -> list[slice]:
    """Return the slices of samples of one run and one held-out group."""
    changes = 1 + np.flatnonzero(np.diff(groups))
    borders = np.unique(np.concatenate([_starts(runs), changes]))
    return [slice(first, end) for first, end in pairwise(borders.tolist())]


def _counted_samples(
    runs: Sequence[JointRun],
    j: int,
    steps: int,
    groups: ndarray,
) -> ndarray:
    """Return the samples ``steps`` before those to which joint ``j`` is commanded to move; of a
    joint that stands still, ``steps`` before all. Both are of one held-out group if any are.
    """
    moving = [run.moving[steps:, j] for run in runs]
    if sum(map(np.count_nonzero, moving)) < LEAST:
        moving = [np.ones_like(samples) for samples in moving]
    before = []
    for start, samples in zip(_starts(runs), moving, strict=False):
        before.append(start + np.flatnonzero(samples))
    before = np.concatenate(before)
    inside = groups[before] == groups[before + steps]
    return before[inside] if inside.any() else before


def fit_joint(
    law: JointErrorModel,
    joint: JointSamples,
    memory: Memory,
    tails: bool,
) -> JointErrorModel:
    """Return the ``law`` of one joint, fitted to its samples."""
    search = NoiseSearch(joint, tails)
    if memory != "full":
        if memory == "none":
            law = replace(law, memory=np.zeros((1, 3)))
        if memory == "autoregressive":
            law = replace(law, memory=_second_order(law, joint)[None])
        return search.fit(law, joint.error, None)
    residuals = joint.error
    for round_ in range(ROUNDS):
        regression = _regression(joint, residuals, joint.past(law, residuals))
        law = search.fit(law, residuals, regression)
        if round_ < ROUNDS - 1:
            gain, residuals = _mean(law, joint, search.size)
            law = replace(law, mean_gain=gain[None])
    return law


class Regression(NamedTuple):
    """Least-squares coefficients."""

    values: ndarray  # (p,)
    root: ndarray  # (p, p) a root of their covariance


def _regression(joint: JointSamples, r: ndarray, past: ndarray) -> Regression:
    """Return the coefficients of the ``past`` (N, p) in ``r`` (N,) one sample later."""
    before = past[joint.first]
    after = r[joint.first + 1]
    moment = before.T @ before
    penalty = 1e-9 * np.diag(moment) + 1e-300
    moment += np.diag(penalty)
    across = before.T @ after
    values = np.linalg.solve(moment, across)
    off = after - before @ values
    variance = np.mean(off**2) + 1e-300
    information = moment / len(after) / variance
    covariance = np.linalg.inv(information)
    root = np.linalg.cholesky(covariance)
    return Regression(values, root)


def _second_order(law: JointErrorModel, joint: JointSamples) -> ndarray:
    """(3,) φ, ψ and 0 of an autoregression of order two, by least squares of one sample."""
    past = joint.past(law, joint.error)[:, :2]
    memory = np.zeros(3)
    memory[:2] = _regression(joint, joint.error, past).values
    return damped_memory(memory, 1.0, law.keep)


class NoiseSearch:
    """Search for the most likely scale, drift, tails and damping of the memory of a joint. A search
    starts where the last one ended.

    Its variables θ are ln s of each growth, ln(ν − 4), the logit of κ, ln of the damping, and the
    shift of the memory in units of its standard errors.
    """

    def __init__(self, joint: JointSamples, tails: bool):
        self.joint = joint
        self.tails = tails
        # rad, a typical error
        mean_square = np.mean(joint.error**2)
        self.size = float(np.sqrt(mean_square)) or 1e-9
        self.theta: ndarray | None = None  # result of the last search
        counts = []
        ends = []
        for steps, before in joint.before.items():
            counts.append(len(before))
            ends.append(before + steps)
        self.horizons = np.array([*joint.before])
        self.counts = np.array(counts)
        self.ends = np.concatenate(ends)

    def fit(
        self,
        law: JointErrorModel,
        r: ndarray,
        regression: Regression | None,
    ) -> JointErrorModel:
        """Return ``law`` with the most likely noise of the residuals ``r`` (N,) in rad; without
        ``regression`` with its own memory.
        """
        from scipy.optimize import minimize

        growth = self.joint.inputs.growth
        size = self.size
        past = self.joint.past(law, r)
        residuals = Residuals(
            r=r / size,
            past=past / size,
            growth=growth,
            horizons=self.horizons,
            ends=self.ends,
            counts=self.counts,
            least=1e-14 + float(law.quantum[0] / size) ** 2 / 12,
        )

        def loss(theta: ndarray) -> float:
            noise = self.noise(theta, law, regression)
            return composite_loss(noise, law.keep, law.persistence, residuals)

        memory = law.memory[0] if regression is None else regression.values
        level = self.log_level(residuals, memory)
        bounds = self.bounds(level)
        rounds = LAST
        if self.theta is None:
            self.theta = self.start(level)
            rounds = LAST if regression is None else FIRST
        best = minimize(
            loss,
            np.clip(self.theta, *np.array(bounds).T),
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": rounds, "ftol": 1e-6},
        )
        self.theta = best.x
        noise = self.noise(best.x, law, regression)
        scale = np.where(growth.any(axis=0), noise.scale * size**2, 0.0)
        return replace(
            law,
            memory=noise.memory[None],
            scale=scale[None],
            drift=np.array([noise.drift]),
            degrees=np.array([noise.degrees]),
        )

    def noise(
        self,
        theta: ndarray,
        law: JointErrorModel,
        regression: Regression | None,
    ) -> NoiseLaw:
        """Return the law of the variables ``theta``, in units of the typical error."""
        bases = law.scale.shape[1]
        scale = np.exp(2 * theta[:bases])
        degrees = np.inf
        if self.tails:
            degrees = DEGREES[0] + np.exp(theta[bases])
        if regression is None:
            return NoiseLaw(law.memory[0], scale, 0.0, degrees)
        drift = 1 / (1 + np.exp(-theta[bases + 1]))
        damping = 1 - np.exp(theta[bases + 2])
        shifted = regression.values + regression.root @ theta[bases + 3 :]
        return NoiseLaw(
            damped_memory(shifted, damping, law.keep),
            scale,
            drift,
            degrees,
        )

    def log_level(self, residuals: Residuals, memory: ndarray) -> float:
        """Return ln of the rms error of the mean with ``memory`` (3,) one sample ahead."""
        steps, before = next(iter(self.joint.before.items()))
        off = residuals.r[before + steps] - residuals.past[before] @ memory
        return np.log(max(float(np.sqrt(np.mean(off**2))), 1e-6))

    def start(self, level: float) -> ndarray:
        """Return the first variables: each growth has half of the variance ``level``."""
        of_one_sample = self.ends[: self.counts[0]]
        growth = self.joint.inputs.growth[of_one_sample]
        typical = [typical_growth(column) for column in growth.T]
        of_growth = np.log(typical) / 2
        scales = level - 0.7 - of_growth
        degrees = np.log(4.0)
        drift = -4.0
        damping = -7.0
        shift = np.zeros(3)
        return np.r_[scales, degrees, drift, damping, shift]

    def bounds(self, level: float) -> list[tuple[float, float]]:
        """Return the bounds of the variables."""
        scales = [(level - 7, level + 7)] * self.joint.inputs.growth.shape[1]
        degrees = (-6.0, np.log(DEGREES[1] - DEGREES[0]))
        drift = (-9.0, 4.0)
        damping = (-14.0, -1.5)
        shift = (-3.0, 3.0)
        return [*scales, degrees, drift, damping, shift, shift, shift]


def typical_growth(column: ndarray) -> float:
    """Return the mean of a factor of the scale over the samples at which it is not 0."""
    active = column[column > 1e-6 * column.max(initial=0.0)]
    return float(active.mean()) if len(active) else 1.0


class Moments(NamedTuple):
    """Moments of the regression for β, weighted: of G held-out groups, of inputs of rms 1."""

    inputs: ndarray  # (G, p, p)
    across: ndarray  # (G, p) of inputs and errors
    square: ndarray  # (G,) of errors

    @classmethod
    def zero(cls, groups: int, p: int) -> "Moments":
        """Moments of no samples of ``groups`` groups and ``p`` inputs."""
        return cls(
            inputs=np.zeros((groups, p, p)),
            across=np.zeros((groups, p)),
            square=np.zeros(groups),
        )

    def add(self, group: int, weight: ndarray, inputs: ndarray, error: ndarray) -> None:
        """Add samples of ``group`` with ``weight`` (M,), ``inputs`` (M, p) and ``error`` (M,)."""
        weighted = inputs.T * weight
        self.inputs[group] += weighted @ inputs
        self.across[group] += weighted @ error
        self.square[group] += weight @ error**2

    def gains(self, penalty: ndarray) -> ndarray:
        """(G, p) ridge regressions without each group; ``penalty`` (p,) adds to the diagonal."""
        inputs = self.inputs.sum(axis=0) - self.inputs
        across = self.across.sum(axis=0) - self.across
        return np.stack(
            [ridge(*group, penalty) for group in zip(inputs, across, strict=True)],
        )

    def loss(self, gains: ndarray) -> float:
        """Weighted squared errors of the groups under their ``gains`` (G, p)."""
        linear = np.sum(self.across * gains)
        quadratic = np.einsum("gi,gij,gj->", gains, self.inputs, gains)
        return float(self.square.sum() - 2 * linear + quadratic)


def ridge(inputs: ndarray, across: ndarray, penalty: ndarray) -> ndarray:
    """(p,) ridge regression from moments; an input of infinite ``penalty`` has no gain."""
    used = np.isfinite(penalty)
    gains = np.zeros(len(across))
    if used.any():
        moment = inputs[np.ix_(used, used)]
        moment += np.diag(penalty[used])
        gains[used] = np.linalg.solve(moment, across[used])
    return gains


def _mean(
    law: JointErrorModel,
    joint: JointSamples,
    size: float,
) -> tuple[ndarray, ndarray]:
    """Return β, and the residuals (N,) of the errors under a β fitted without their group."""
    unit = np.sqrt(np.mean(joint.inputs.mean**2, axis=0)) + 1e-12
    x = joint.inputs.mean / unit
    _, groups = np.unique(joint.groups, return_inverse=True)
    moments = _moments(law, joint, x, groups, size)
    total = moments.inputs.sum(axis=0)
    # of all groups: inputs that a fold lacks have no gain in it
    size_of_input = np.diag(total) + 1e-12 * np.trace(total) + 1e-300
    least = np.inf
    penalty = size_of_input
    gains = np.zeros_like(moments.across)
    for penalties in _penalties(jumps=x[:, JUMP_INPUTS].any()):
        trial = size_of_input * penalties
        trial_gains = moments.gains(trial)
        loss = moments.loss(trial_gains)
        if loss <= least:
            least = loss
            penalty = trial
            gains = trial_gains
    gain = ridge(total, moments.across.sum(axis=0), penalty) / unit
    held_out_mean = np.sum(x * gains[groups], axis=1)
    return gain, joint.error - held_out_mean


def _penalties(jumps: bool) -> Iterator[ndarray]:
    """Yield the penalties (len(INPUTS),) that are compared; without ``jumps`` of the speed the
    inputs of the jumps have no gain.
    """
    of_jumps = PENALTIES if jumps else PENALTIES[-1:]
    for smooth, jump in product(PENALTIES, of_jumps):
        yield np.where(JUMP_INPUTS, jump, smooth)


def _weights(law: JointErrorModel, error: ndarray, variance: ndarray) -> ndarray:
    """(M,) weights of errors of one joint: the inverse ``variance``, smaller in the tails."""
    weight = 1 / variance
    nu = law.degrees[0]
    if np.isfinite(nu):
        square = error**2 / (variance * unit_variance_factor(law.degrees)[0])
        weight *= (nu + 1) / (nu + square)
    return weight


def _moments(
    law: JointErrorModel,
    joint: JointSamples,
    x: ndarray,
    groups: ndarray,
    size: float,
) -> Moments:
    """Return the moments of the errors and inputs ``x`` (N, p) that their past does not predict,
    each with the weight that the law's noise gives it, by the numbers ``groups`` (N,).
    """
    weights, impulse = law.response([*joint.before][-1])
    past_error = joint.past(law, joint.error)
    past_x = joint.past(law, x)
    std = np.sqrt(joint.inputs.growth @ law.scale[0])[:, None]
    count = groups.max() + 1
    moments = Moments.zero(count, x.shape[1])
    for steps, before in joint.before.items():
        end = before + steps
        row = weights[steps - 1, 0]
        error = joint.error[end] - past_error[before] @ row
        inputs = x[end] - np.einsum("kif,i->kf", past_x[before], row)
        variance = law.variance(std, end, steps, impulse)[:, 0] + 1e-14 * size**2
        weight = _weights(law, error, variance)
        for group in range(count):
            inside = groups[end] == group
            moments.add(group, weight[inside], inputs[inside], error[inside])
    return moments
