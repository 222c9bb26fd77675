"""Error of a position-controlled joint about its command, with memory:

    e_k = q_k − c_k = m_k + r_k,   r_{k+1} = φr_k + ψr_{k−1} + χz_k + s_{k+1}η_{k+1},

c are the commanded angles after the run's own lag, z is the exponential mean of r over
:data:`MEMORY` s. The mean m = βᵀx depends on the command alone: x has a constant, the commanded
speed, its step from sample to sample (acceleration), its sign, the part of the sign younger than
:data:`~.drive.YOUNG` s (a reversed joint first sticks), and the jumps of the speed that are
younger: a step of the speed is a jump, and no acceleration, if it exceeds the greatest smooth one.
The whole step counts: what exceeds a threshold by a hair would have a gain without bound. The scale

    s² = a + b·g(|ċ|) + c·|ċ| + d·ρ² + e·σ²,   g = |ċ|ᵖ and c = 0, or g = ċ²/(ċ² + SLOW²),

ρ is the last young part of the sign and σ that of the jumps in rad/s. A constant variance
(p = 0) has b = c = d = e = 0. η has mean 0 and variance 1, normal or Student's t. It is the sum of
a white part and a drift u that decays over :data:`DRIFT` s and has the share κ of the variance: it
widens predictions at long horizons. Given r and z at sample k, the mean h samples ahead follows
from powers of the companion matrix; the variance is, with the impulse response ψ_i,

    Σ_{i<h} (1 − κ)ψ_i²s² + κ·Var Σ_{i<h} ψ_i s u.

Without memory, φ = 1 and ψ = χ = κ = 0, m = 0: the error persists, and its steps are white. Joints
are independent. The law needs no Jacobian.
"""

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import Chain
from pipeline.arm.interface import Mechanism
from pipeline.core.delays import delayed_angles
from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_error.drive import (
    GROWTH,
    INPUTS,
    SATURATING,
    TURN,
    YOUNG,
    Drive,
    drive_of,
    smoothed,
)
from pipeline.models.joint_error.likelihood import companion_of
from pipeline.models.joint_error.outlook import Outlook
from pipeline.models.model import MotionModel, Traits, trace_factor

# s, time constants of z and u
MEMORY = 0.1
DRIFT = 0.1
# parameters with more than a number a joint: shape of the numbers of a joint
SHAPES = {"memory": (3,), "mean_gain": (len(INPUTS),), "scale": (len(GROWTH),)}
# parameters that may be negative, or are bounded
ENDS = {
    "memory": (-np.inf, np.inf),
    "mean_gain": (-np.inf, np.inf),
    "lag": (-np.inf, np.inf),
    "degrees": (2.0, np.inf),
    "drift": (0.0, 1.0),
}
ROUNDED = 1e-9  # greatest excess of the memory's spectral radius over 1
CHUNK = 1024  # samples whose variances are computed together


def past_of(r: ndarray, keep: float) -> ndarray:
    """(N, ..., 3) r, previous r and z at every sample of ``r`` (N, ...)."""
    previous = np.concatenate([r[:1], r[:-1]])
    return np.stack([r, previous, smoothed(r, keep)], axis=-1)


def weighted_sums(values: ndarray, weights: ndarray) -> ndarray:
    """(N, n) sums over i of ``values`` (N, n, i) times ``weights`` (n, i)."""
    return np.einsum("kji,ji->kj", values, weights)


class Memory(NamedTuple):
    """State of P arms of n joints after a sample, each (P, n)."""

    command: ndarray  # rad, commanded pose
    speed: ndarray  # rad/s, of the command
    fresh_sign: ndarray  # exponential means of the sign over YOUNG
    late_sign: ndarray
    fresh_jumps: ndarray  # rad/s, fading sums of the jumps over YOUNG
    late_jumps: ndarray
    mean: ndarray  # rad, m
    previous: ndarray  # rad, r of the sample before
    z: ndarray  # rad
    drift: ndarray  # u


@dataclass(frozen=True)
class JointErrorModel(MotionModel):
    """Law of the errors of n joints about their command."""

    joints: tuple[str, ...]
    rate: float  # samples per second
    memory: ndarray  # (n, 3) φ, ψ, χ
    mean_gain: ndarray  # (n, len(INPUTS)) β: rad per unit of the input, s
    scale: ndarray  # (n, len(GROWTH)) a, b, c, d: rad² per unit of the growth
    drift: ndarray  # (n,) κ
    degrees: ndarray  # (n,) ν; infinite for normal noise
    reach: ndarray  # (n,) rad/s, greatest recorded commanded speed
    quantum: ndarray  # (n,) rad, step of the recorded angles
    jump: ndarray  # (n,) rad/s², acceleration beyond which the commanded speed jumps
    lag: ndarray  # (n,) s, mean lag of the measured angles behind the command
    lag_std: ndarray  # (n,) s, standard deviation of the lag of another run about it
    power: float | str = SATURATING  # p
    traits: ClassVar = Traits(
        noisy_at_rest=True,
        needs_jacobian=False,
        compiled=False,
        memory=True,
    )

    @property
    def keep(self) -> float:
        """Weight of the last exponential mean in z."""
        return float(np.exp(-1 / (self.rate * MEMORY)))

    @property
    def keeps(self) -> list[float]:
        """Weights at one sample of the parts that are younger than YOUNG."""
        return [float(np.exp(-1 / (self.rate * duration))) for duration in YOUNG]

    @property
    def persistence(self) -> float:
        """Autocorrelation of the drift u at one sample."""
        return float(np.exp(-1 / (self.rate * DRIFT)))

    def of_joint(self, j: int) -> "JointErrorModel":
        """Return the law of joint ``j``."""
        arrays = {}
        for name, value in vars(self).items():
            if isinstance(value, ndarray):
                arrays[name] = value[[j]]
        return replace(self, joints=(self.joints[j],), **arrays)

    def inputs(self, command: ndarray) -> Drive:
        """Return the inputs at every sample of ``command`` (N, n) in rad."""
        speed = np.zeros_like(command)
        speed[1:] = self.rate * np.diff(command, axis=0)
        if len(speed) > 1:
            speed[0] = speed[1]
        change = np.zeros_like(speed)
        change[1:] = self.rate * np.diff(speed, axis=0)
        smooth = self.smooth_part(change)
        sign = np.tanh(speed / TURN)
        jumps = (change - smooth) / self.rate
        young = [sign - smoothed(sign, keep) for keep in self.keeps]
        for keep in self.keeps:
            fading_sum = smoothed(jumps, keep) / (1 - keep)
            young.append(fading_sum)
        return drive_of(speed, smooth, sign, young, self.power)

    def smooth_part(self, acceleration: ndarray) -> ndarray:
        """(..., n) ``acceleration`` in rad/s², 0 where the commanded speed jumps."""
        return np.where(np.abs(acceleration) > self.jump, 0.0, acceleration)

    def companion(self) -> ndarray:
        """(n, 3, 3) matrix that maps (r_k, r_{k−1}, z_k) to its mean one sample later."""
        matrices = [companion_of(memory, self.keep) for memory in self.memory]
        return np.stack(matrices)

    def response(self, steps: int) -> tuple[ndarray, ndarray]:
        """Weights (steps, n, 3) of (r, previous r, z) in the mean 1 … ``steps`` samples ahead, and
        impulse response (steps, n) ψ_0 … of an innovation.
        """
        power = self.companion()
        rows = np.zeros((len(self.joints), 1, 3))
        rows[:, 0, 0] = 1.0
        while rows.shape[1] <= steps:
            # rows k … 2k − 1 are the first k times the k-th power
            following = rows @ power
            rows = np.concatenate([rows, following], axis=1)
            power = power @ power
        innovation = np.array([1.0, 0.0, 1 - self.keep])
        impulse = rows[:, :steps] @ innovation
        weights = rows[:, 1 : steps + 1]
        return weights.swapaxes(0, 1), impulse.T

    def mean_error(self, inputs: Drive) -> ndarray:
        """(N, n) m in rad at every sample."""
        return weighted_sums(inputs.mean, self.mean_gain)

    def innovation_std(self, inputs: Drive) -> ndarray:
        """(N, n) s in rad at every sample."""
        return np.sqrt(weighted_sums(inputs.growth, self.scale))

    def residuals(self, error: ndarray, inputs: Drive) -> ndarray:
        """(N, n, 3) r, previous r and z in rad at every sample of ``error`` (N, n)."""
        return past_of(error - self.mean_error(inputs), self.keep)

    def variance(
        self,
        std: ndarray,
        ends: ndarray,
        steps: int,
        impulse: ndarray,
    ) -> ndarray:
        """(len(ends), n) variances in rad² of the errors at samples ``ends``, given those ``steps``
        samples before, for innovations of standard deviation ``std`` (N, n) at each sample.
        """
        variances = []
        for first in range(0, max(len(ends), 1), CHUNK):
            chunk = ends[first : first + CHUNK]
            back = chunk - np.arange(steps)[:, None]
            response = impulse[:steps, None] * std[back]
            variances.append(self._variance_of(response))
        return np.concatenate(variances)

    def _variance_of(self, response: ndarray) -> ndarray:
        """(K, n) variances in rad² of errors whose innovation i samples ago adds a standard
        deviation ``response`` (steps, K, n) in rad.
        """
        keep = self.persistence
        share = self.drift
        variances = (1 - share) * response**2
        white = variances.sum(axis=0)
        if not np.any(share > 0):
            return white
        # response to an innovation of the drift i samples ago
        for i in range(1, len(response)):
            response[i] += keep * response[i - 1]
        squares = response**2
        drifted = (1 - keep**2) * squares.sum(axis=0)
        last_known = keep**2 * squares[-1]
        return white + share * (drifted + last_known)

    def outlook(
        self,
        error: ndarray,
        inputs: Drive,
        steps: int,
        lag_known: bool = True,
    ) -> Outlook:
        """Law at samples ``steps`` … N−1 of ``error`` (N, n) in rad, each given the errors until
        ``steps`` samples before and the commands. Shapes (N − steps, n). If the lag of the run is
        not known, errors and inputs are those at the mean lag, and the variance includes lag_std:
        a lag that is longer by δ adds −δċ to every error.
        """
        weights, impulse = self.response(steps)
        last = weights[-1]
        before = self.residuals(error, inputs)[: len(error) - steps]
        mean = weighted_sums(before, last)
        mean += self.mean_error(inputs)[steps:]
        ends = np.arange(steps, len(error))
        std = self.innovation_std(inputs)
        variance = self.variance(std, ends, steps, impulse)
        if not lag_known:
            speed = inputs.mean[..., INPUTS.index("speed")]
            past = past_of(speed, self.keep)[: len(error) - steps]
            unforeseen = speed[steps:] - weighted_sums(past, last)
            variance += (self.lag_std * unforeseen) ** 2
        return Outlook(mean, variance, self.degrees)

    def predict(
        self,
        errors: ndarray,
        commands: ndarray,
        steps: int,
        lag: float | ndarray | None = None,
    ) -> tuple[ndarray, ndarray]:
        """Return mean (n,) in rad and covariance (n, n) in rad² of the recorded error, its rounding
        included, ``steps`` samples after the last of the known ``errors`` (K, n); the arm starts at
        rest if none is known. ``commands`` are the commanded angles, as sent, at these samples and
        at least the next ``steps``; errors are about them. ``lag`` in s is the run's, if it is
        known: a number or (n,); else the mean lag holds, and the covariance includes its spread.
        """
        if steps < 1 or len(commands) < len(errors) + steps:
            raise ModelDomainError(
                f"commands must have a row for each of the {len(errors)} errors and each "
                f"of the {steps} next samples, got {len(commands)}",
            )
        if not len(errors):  # at rest at the first command before it
            commands = np.concatenate([commands[:1], commands])
        late = self.lag if lag is None else np.broadcast_to(lag, self.lag.shape)
        delayed = delayed_angles(commands, self.rate * late)
        shift = delayed - commands
        about_delayed = self.mean_gain[None, :, 0]
        if len(errors):
            about_delayed = errors - shift[: len(errors)]
        total = len(about_delayed) + steps
        padded = np.pad(about_delayed, ((0, steps), (0, 0)), mode="edge")
        inputs = self.inputs(delayed[:total])
        law = self.outlook(padded, inputs, steps, lag_known=lag is not None)
        covariance = np.diag(law.variance[-1] + self.quantum**2 / 12)
        return law.mean[-1] + shift[total - 1], covariance

    def covariance_of_joint_step(self, dq: ndarray) -> ndarray:
        """(..., n, n) covariance in rad² of the next error, given the errors until now, for
        commanded steps ``dq`` (..., n) in rad of constant speed.
        """
        growth = self.inputs(np.stack([np.zeros_like(dq), dq])).growth[-1]
        variance = np.einsum("...ji,ji->...j", growth, self.scale)
        return variance[..., None] * np.eye(dq.shape[-1])

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        dq = chain.nominal_step(q, v)
        return self.covariance_of_joint_step(np.broadcast_to(dq, np.shape(q)))

    def log_density(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        q_next: ndarray,
        measurement=None,
    ) -> ndarray:
        """(...,) ln p in rad⁻ⁿ of one step without memory; a ``measurement`` (n, n) in rad² adds
        the variances of its diagonal.
        """
        variance = np.diagonal(self.covariance(chain, q, v), axis1=-2, axis2=-1)
        variance = variance + (0.0 if measurement is None else np.diag(measurement))
        law = Outlook(self.mean(chain, q, v), variance, self.degrees)
        return law.log_probability(q_next, np.zeros(len(self.joints))).sum(axis=-1)

    def with_trace(self, chain: Mechanism, q: ndarray, v: ndarray, trace: float):
        """Return the law with all variances times one factor; ModelDomainError for zero noise."""
        factor = trace_factor(self.covariance(chain, q, v), trace)
        return replace(self, scale=factor * self.scale)

    def sample(self, chain: Chain, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        """(..., n) draws of a step without memory."""
        variance = np.diagonal(self.covariance(chain, q, v), axis1=-2, axis2=-1)
        noise = self.unit_noise(np.shape(q), rng)
        return self.mean(chain, q, v) + np.sqrt(variance) * noise

    def unit_noise(self, shape: tuple[int, ...], rng: Generator) -> ndarray:
        """Draws of ``shape`` (..., n) with mean 0, variance 1 and the tails of the law."""
        noise = rng.standard_normal(shape)
        for j, degrees in enumerate(self.degrees):
            if np.isfinite(degrees):
                chi = rng.chisquare(degrees, shape[:-1])
                factor = np.sqrt((degrees - 2) / chi)
                noise[..., j] *= factor
        return noise

    def first_memory(self, q: ndarray, commanded: ndarray, rng: Generator) -> ndarray:
        """(P, 10n) :class:`Memory` of first poses ``q`` (P, n) in rad at rest at ``commanded``
        (n,), in a filter the mean of the training takes' first poses.
        """
        zero = np.zeros_like(q)
        command = zero + commanded
        offset = zero + self.mean_gain[:, 0]
        r = q - commanded - offset
        memory = Memory(
            command=command,
            speed=zero,
            fresh_sign=zero,
            late_sign=zero,
            fresh_jumps=zero,
            late_jumps=zero,
            mean=offset,
            previous=r,
            z=r,
            drift=rng.standard_normal(q.shape),
        )
        return np.concatenate(memory, axis=-1)

    def advance(
        self,
        chain: Chain,
        q: ndarray,
        v: ndarray,
        memory: ndarray,
        rng: Generator,
    ) -> tuple[ndarray, ndarray]:
        """Return draws (P, n) of the next poses in rad, and their memory (P, 10n), after ``q``
        (P, n) and ``memory`` under the commands ``v`` (m,) or (P, m) of the commanded pose.
        """
        command = memory[:, : q.shape[-1]]
        return self.follow(q, chain.nominal_step(command, v), memory, rng)

    def follow(
        self,
        q: ndarray,
        dq: ndarray,
        memory: ndarray,
        rng: Generator,
    ) -> tuple[ndarray, ndarray]:
        """Return :meth:`advance` for the commanded joint steps ``dq`` (n,) or (P, n) in rad."""
        before = Memory(*np.split(memory, len(Memory._fields), axis=-1))
        dq = dq + np.zeros_like(q)
        speed = self.rate * dq
        change = self.rate * (speed - before.speed)
        smooth = self.smooth_part(change)
        sign = np.tanh(speed / TURN)
        jump = (change - smooth) / self.rate

        fresh, late = self.keeps
        fresh_sign = fresh * before.fresh_sign + (1 - fresh) * sign
        late_sign = late * before.late_sign + (1 - late) * sign
        fresh_jumps = fresh * before.fresh_jumps + jump
        late_jumps = late * before.late_jumps + jump
        young = [sign - fresh_sign, sign - late_sign, fresh_jumps, late_jumps]
        inputs = drive_of(speed, smooth, sign, young, self.power)

        r = q - before.command - before.mean
        z = self.keep * before.z + (1 - self.keep) * r
        past = np.stack([r, before.previous, z], axis=-1)
        expected = weighted_sums(past, self.memory)
        fade = self.persistence
        white = np.sqrt(1 - fade**2) * rng.standard_normal(q.shape)
        drift = fade * before.drift + white
        noise = np.sqrt(1 - self.drift) * self.unit_noise(q.shape, rng)
        noise += np.sqrt(self.drift) * drift
        next_r = expected + self.innovation_std(inputs) * noise

        command = before.command + dq
        mean = self.mean_error(inputs)
        after = Memory(
            command=command,
            speed=speed,
            fresh_sign=fresh_sign,
            late_sign=late_sign,
            fresh_jumps=fresh_jumps,
            late_jumps=late_jumps,
            mean=mean,
            previous=r,
            z=z,
            drift=drift,
        )
        return command + mean + next_r, np.concatenate(after, axis=-1)

    def parameters(self) -> dict[str, Any]:
        """Plain values for :func:`build`; null for infinite degrees of freedom."""
        plain: dict[str, Any] = {"kind": "joint_error"}
        for name, value in vars(self).items():
            plain[name] = np.asarray(value).tolist()
        degrees = plain["degrees"]
        plain["degrees"] = [None if np.isinf(nu) else nu for nu in degrees]
        return plain


def build(parameters: dict[str, Any]) -> JointErrorModel:
    """Build the law from the values of :meth:`JointErrorModel.parameters`. Raises ModelDomainError
    for an invalid value and for a memory whose errors grow.
    """
    values = {field.name: parameters[field.name] for field in fields(JointErrorModel)}
    values["joints"] = tuple(values["joints"])
    values["degrees"] = [np.inf if nu is None else nu for nu in values["degrees"]]
    power = values["power"]
    if power != SATURATING and not isinstance(power, int | float):
        message = f"parameters.power must be a number or {SATURATING!r}, got {power!r}"
        raise ModelDomainError(message)
    for name in set(values) - {"joints", "rate", "power"}:
        values[name] = _array(name, values[name], len(values["joints"]))
    law = JointErrorModel(**values)
    radius = np.abs(np.linalg.eigvals(law.companion())).max()
    if radius > 1 + ROUNDED:
        raise ModelDomainError(
            f"parameters.memory is unstable: errors grow {radius:.4g} times a sample; "
            "a factor of at most 1 is required",
        )
    return law


def _array(name: str, value: object, n: int) -> ndarray:
    """Return the ``value`` of a parameter of ``n`` joints; ModelDomainError if it is invalid."""
    array = np.array(value, float)
    shape = (n, *SHAPES.get(name, ()))
    low, high = ENDS.get(name, (0.0, np.inf))
    inside = (low <= array) & (array <= high)
    if array.shape != shape or not inside.all():
        raise ModelDomainError(
            f"parameters.{name} must be numbers from {low:g} to {high:g} of shape "
            f"{shape}, got {array.tolist()}",
        )
    return array
