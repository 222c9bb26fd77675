"""Error of a position-controlled joint about its command, with memory:

    e_k = q_k − c_k = m_k + r_k,   r_{k+1} = φr_k + ψr_{k−1} + χz_k + s_{k+1}η_{k+1},

c are the commanded angles after the run's own lag, z is the exponential mean of r over
:data:`MEMORY` s. The mean m = βᵀx depends on the command alone: x has a constant, the commanded
speed, its step from sample to sample (acceleration), its sign, the part of the sign younger than
:data:`YOUNG` s (a reversed joint first sticks), and the jumps of the speed that are younger: a
jump is the part of an acceleration beyond the greatest smooth one. The scale

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
from math import lgamma
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import Chain
from pipeline.arm.interface import Mechanism
from pipeline.core.delays import delayed_angles
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import MotionModel, Traits, trace_factor

MEMORY, DRIFT = 0.1, 0.1  # s, time constants of z and u
YOUNG = (0.05, 0.2)  # s
TURN = 0.01  # rad/s, speed at which the smoothed sign is tanh 1
SLOW = 0.0125  # rad/s, speed at which a saturating variance has half of its growth
GROWTH = ("rest", "growth", "speed", "late sign", "jumps")  # terms of the variance s²
JUMPS = GROWTH.index("jumps")
INPUTS = (
    "offset",
    "speed",
    "acceleration",
    "sign",
    "fresh sign",
    "late sign",
    "fresh jumps",
    "late jumps",
)
SATURATING = "saturating"
ROUNDED = 1e-9  # greatest excess of the memory's spectral radius over 1
CHUNK = 1024  # samples whose variances are computed together


class Drive(NamedTuple):
    """Inputs of the law at N samples of a command of n joints."""

    mean: ndarray  # (N, n, len(INPUTS)) x
    growth: ndarray  # (N, n, len(GROWTH)) factors of a, b, c and d


class Outlook(NamedTuple):
    """Law of the errors h samples after the last of the known ones, Student's t or normal."""

    mean: ndarray  # (..., n) rad
    variance: ndarray  # (..., n) rad², before the angles are rounded to their quantum
    degrees: ndarray  # (n,)

    def log_probability(self, error: ndarray, quantum: ndarray) -> ndarray:
        """(..., n) ln of the probability of the cell of width ``quantum`` (n,) in rad around
        ``error``, divided by the width; ln of the density where ``quantum`` is 0. In nats (1/rad).
        """
        scale = np.sqrt(self.variance * unit_variance_factor(self.degrees))
        z, half = np.abs(error - self.mean) / scale, quantum / scale / 2
        degrees = np.broadcast_to(self.degrees, z.shape)
        density = standard_log_density(z, degrees) - np.log(scale)
        if not np.any(quantum > 0):
            return density
        from scipy.special import ndtr, stdtr

        normal = np.isinf(degrees)
        finite = np.where(normal, 1.0, degrees)
        low, high = -(z + half), -(z - half)
        student = stdtr(finite, high) - stdtr(finite, low)
        cell = np.where(normal, ndtr(high) - ndtr(low), student)
        width = np.where(quantum > 0, quantum, 1.0)
        return np.where(
            cell > 1e-280, np.log(np.maximum(cell, 1e-300) / width), density
        )


def unit_variance_factor(degrees: ndarray) -> ndarray:
    """(n,) squared scale of Student's t of variance 1."""
    finite = np.where(np.isinf(degrees), 3.0, degrees)
    return np.where(np.isinf(degrees), 1.0, (finite - 2) / finite)


def standard_log_density(z: ndarray, degrees: ndarray) -> ndarray:
    """(...,) log density of Student's t of scale 1, or of the normal law for infinite degrees."""
    nu = np.where(np.isinf(degrees), 4.0, degrees)
    gamma = np.vectorize(lambda d: lgamma((d + 1) / 2) - lgamma(d / 2), otypes=[float])
    known, places = np.unique(nu, return_inverse=True)
    constant = gamma(known)[places].reshape(nu.shape) - 0.5 * np.log(nu * np.pi)
    student = constant - (nu + 1) / 2 * np.log1p(z**2 / nu)
    return np.where(np.isinf(degrees), -0.5 * (np.log(2 * np.pi) + z**2), student)


def smoothed(x: ndarray, keep: float) -> ndarray:
    """Exponential mean of ``x`` (N, ...) over time, from its first value; the weight of a value
    falls by the factor ``keep`` a sample.
    """
    result = (1 - keep) * x
    result[:1] = x[:1]
    lag = 1  # the sum of 2·lag terms is that of lag terms and, lag samples earlier, as many more
    while lag < len(x):
        result[lag:] = result[lag:] + keep**lag * result[:-lag]
        lag *= 2
    return result


def past_of(r: ndarray, keep: float) -> ndarray:
    """(N, ..., 3) r, previous r and z at every sample of ``r`` (N, ...)."""
    return np.stack([r, np.concatenate([r[:1], r[:-1]]), smoothed(r, keep)], axis=-1)


def _terms(
    speed: ndarray,
    change: ndarray,
    sign: ndarray,
    young: list[ndarray],
    power: float | str,
) -> Drive:
    """Return the inputs of speed in rad/s, acceleration without jumps, sign and ``young`` parts:
    two of the sign, then two of the jumps.
    """
    constant, still, size = np.ones_like(speed), np.zeros_like(speed), np.abs(speed)
    mean = [constant, speed, change, sign, *young]
    if power == 0:
        growth = [constant, still, still, still, still]
    elif power == SATURATING:
        saturated = speed**2 / (speed**2 + SLOW**2)
        growth = [constant, saturated, size, young[1] ** 2, young[3] ** 2]
    else:
        growth = [constant, size**power, still, young[1] ** 2, young[3] ** 2]
    return Drive(np.stack(mean, axis=-1), np.stack(growth, axis=-1))


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
    lag_std: (
        ndarray  # (n,) s, standard deviation of the lag of another run about the mean
    )
    power: float | str = SATURATING  # p
    traits: ClassVar = Traits(
        noisy_at_rest=True, needs_jacobian=False, compiled=False, memory=True
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
        for field in fields(self):
            if isinstance(value := getattr(self, field.name), ndarray):
                arrays[field.name] = value[[j]]
        return replace(self, joints=(self.joints[j],), **arrays)

    def inputs(self, command: ndarray) -> Drive:
        """Return the inputs at every sample of ``command`` (N, n) in rad."""
        speed = np.zeros_like(command)
        speed[1:] = self.rate * np.diff(command, axis=0)
        if len(speed) > 1:
            speed[0] = speed[1]
        change = np.zeros_like(speed)
        change[1:] = self.rate * np.diff(speed, axis=0)
        smooth = np.clip(change, -self.jump, self.jump)
        sign, young = np.tanh(speed / TURN), []
        for keep in self.keeps:
            young.append(sign - smoothed(sign, keep))
        for keep in self.keeps:
            jumps = smoothed((change - smooth) / self.rate, keep)
            young.append(jumps / (1 - keep))
        return _terms(speed, smooth, sign, young, self.power)

    def companion(self) -> ndarray:
        """(n, 3, 3) matrix that maps (r_k, r_{k−1}, z_k) to its mean one sample later."""
        result = np.zeros((len(self.joints), 3, 3))
        result[:, 0], result[:, 1, 0] = self.memory, 1.0
        result[:, 2] = (1 - self.keep) * self.memory
        result[:, 2, 2] += self.keep
        return result

    def response(self, steps: int) -> tuple[ndarray, ndarray]:
        """Weights (steps, n, 3) of (r, previous r, z) in the mean 1 … ``steps`` samples ahead, and
        impulse response (steps, n) ψ_0 … of an innovation.
        """
        power, rows = self.companion(), np.zeros((len(self.joints), 1, 3))
        rows[:, 0, 0] = 1.0
        while (
            rows.shape[1] <= steps
        ):  # rows k … 2k − 1 are the first k times the k-th power
            rows, power = np.concatenate([rows, rows @ power], axis=1), power @ power
        impulse = rows[:, :steps] @ np.array([1.0, 0.0, 1 - self.keep])
        return rows[:, 1 : steps + 1].swapaxes(0, 1), impulse.T

    def residuals(self, error: ndarray, inputs: Drive) -> ndarray:
        """(N, n, 3) r, previous r and z in rad at every sample of ``error`` (N, n)."""
        return past_of(
            error - np.einsum("kji,ji->kj", inputs.mean, self.mean_gain), self.keep
        )

    def variance(
        self, std: ndarray, ends: ndarray, steps: int, impulse: ndarray
    ) -> ndarray:
        """(len(ends), n) variances in rad² of the errors at samples ``ends``, given those ``steps``
        samples before, for innovations of standard deviation ``std`` (N, n) at each sample.
        """
        keep, share, parts = self.persistence, self.drift, []
        for first in range(0, max(len(ends), 1), CHUNK):
            back = ends[first : first + CHUNK] - np.arange(steps)[:, None]
            each = impulse[:steps, None] * std[back]
            total = ((1 - share) * each**2).sum(axis=0)
            if np.any(share > 0):
                for i in range(
                    1, steps
                ):  # response to an innovation of the drift i samples ago
                    each[i] += keep * each[i - 1]
                total += share * (
                    (1 - keep**2) * (each**2).sum(axis=0) + keep**2 * each[-1] ** 2
                )
            parts.append(total)
        return np.concatenate(parts)

    def outlook(
        self, error: ndarray, inputs: Drive, steps: int, lag_known: bool = True
    ) -> Outlook:
        """Law at samples ``steps`` … N−1 of ``error`` (N, n) in rad, each given the errors until
        ``steps`` samples before and the commands. Shapes (N − steps, n). If the lag of the run is
        not known, errors and inputs are those at the mean lag, and the variance includes lag_std:
        a lag that is longer by δ adds −δċ to every error.
        """
        weights, impulse = self.response(steps)
        last = weights[-1]
        before = self.residuals(error, inputs)[: len(error) - steps]
        mean = np.einsum("kji,ji->kj", before, last)
        mean += np.einsum("kji,ji->kj", inputs.mean[steps:], self.mean_gain)
        variance = self.variance(
            self.innovation_std(inputs), np.arange(steps, len(error)), steps, impulse
        )
        if not lag_known:
            speed = inputs.mean[..., INPUTS.index("speed")]
            past = past_of(speed, self.keep)[: len(error) - steps]
            unforeseen = speed[steps:] - np.einsum("kji,ji->kj", past, last)
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
            message = f"commands must have a row for each of the {len(errors)} errors and each of "
            raise ModelDomainError(
                f"{message}the {steps} next samples, got {len(commands)}"
            )
        if not len(errors):  # at rest at the first command before it
            commands = np.concatenate([commands[:1], commands])
        late = self.lag if lag is None else np.broadcast_to(lag, self.lag.shape)
        delayed = delayed_angles(commands, self.rate * late)
        shift = delayed - commands
        if len(errors):
            known = errors - shift[: len(errors)]
        else:
            known = self.mean_gain[None, :, 0]
        total = len(known) + steps
        padded = np.concatenate([known, np.tile(known[-1:], (steps, 1))])
        inputs = self.inputs(delayed[:total])
        law = self.outlook(padded, inputs, steps, lag_known=lag is not None)
        covariance = np.diag(law.variance[-1] + self.quantum**2 / 12)
        return law.mean[-1] + shift[total - 1], covariance

    def innovation_std(self, inputs: Drive) -> ndarray:
        """(N, n) s in rad at every sample."""
        return np.sqrt(np.einsum("kji,ji->kj", inputs.growth, self.scale))

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
        return replace(
            self, scale=trace_factor(self.covariance(chain, q, v), trace) * self.scale
        )

    def sample(self, chain: Chain, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        """(..., n) draws of a step without memory."""
        variance = np.diagonal(self.covariance(chain, q, v), axis1=-2, axis2=-1)
        return self.mean(chain, q, v) + np.sqrt(variance) * self.unit_noise(
            np.shape(q), rng
        )

    def unit_noise(self, shape: tuple[int, ...], rng: Generator) -> ndarray:
        """Draws of ``shape`` (..., n) with mean 0, variance 1 and the tails of the law."""
        noise = rng.standard_normal(shape)
        for j in np.flatnonzero(np.isfinite(self.degrees)):
            chi = rng.chisquare(self.degrees[j], shape[:-1])
            noise[..., j] *= np.sqrt((self.degrees[j] - 2) / chi)
        return noise

    def first_memory(self, q: ndarray, commanded: ndarray, rng: Generator) -> ndarray:
        """(P, 10n) memory of first poses ``q`` (P, n) in rad at rest at ``commanded`` (n,), in a
        filter the mean of the training takes' first poses: commanded pose, its speed, the two means
        of the sign, two sums of jumps, m, previous r and z, and u.
        """
        still, offset = np.zeros_like(q), np.zeros_like(q) + self.mean_gain[:, 0]
        r, command = q - commanded - offset, np.zeros_like(q) + commanded
        drift = rng.standard_normal(q.shape)
        return np.concatenate([command, *[still] * 5, offset, r, r, drift], axis=-1)

    def advance(
        self, chain: Chain, q: ndarray, v: ndarray, memory: ndarray, rng: Generator
    ) -> tuple[ndarray, ndarray]:
        """Return draws (P, n) of the next poses in rad, and their memory (P, 10n), after ``q``
        (P, n) and ``memory`` under the commands ``v`` (m,) or (P, m) of the commanded pose.
        """
        return self.follow(
            q, chain.nominal_step(memory[:, : q.shape[-1]], v), memory, rng
        )

    def follow(
        self, q: ndarray, dq: ndarray, memory: ndarray, rng: Generator
    ) -> tuple[ndarray, ndarray]:
        """Return :meth:`advance` for the commanded joint steps ``dq`` (n,) or (P, n) in rad."""
        command, speed, *parts, mean, before, z, drift = np.split(memory, 10, axis=-1)
        dq = dq + np.zeros_like(q)
        now = self.rate * dq
        sign, change = np.tanh(now / TURN), self.rate * (now - speed)
        smooth = np.clip(change, -self.jump, self.jump)
        means, jumps = parts[:2], parts[2:]
        for i, keep in enumerate(self.keeps):
            means[i] = keep * means[i] + (1 - keep) * sign
            jumps[i] = keep * jumps[i] + (change - smooth) / self.rate
        young = [sign - means[0], sign - means[1], *jumps]
        inputs = _terms(now, smooth, sign, young, self.power)
        r = q - command - mean
        z = self.keep * z + (1 - self.keep) * r
        moved = np.einsum("kji,ji->kj", np.stack([r, before, z], axis=-1), self.memory)
        fade = self.persistence
        drift = fade * drift + np.sqrt(1 - fade**2) * rng.standard_normal(q.shape)
        noise = np.sqrt(1 - self.drift) * self.unit_noise(q.shape, rng)
        noise += np.sqrt(self.drift) * drift
        moved += self.innovation_std(inputs) * noise
        mean = np.einsum("kji,ji->kj", inputs.mean, self.mean_gain)
        after = [command + dq, now, *means, *jumps, mean, r, z, drift]
        return command + dq + mean + moved, np.concatenate(after, axis=-1)

    def parameters(self) -> dict[str, Any]:
        """Plain values for :func:`build`; null for infinite degrees of freedom."""
        plain = {each.name: getattr(self, each.name) for each in fields(self)}
        plain = {key: np.asarray(value).tolist() for key, value in plain.items()}
        plain["degrees"] = [
            each if np.isfinite(each) else None for each in plain["degrees"]
        ]
        return {"kind": "joint_error"} | plain


def build(parameters: dict[str, Any]) -> JointErrorModel:
    """Build the law from the values of :meth:`JointErrorModel.parameters`."""
    values = {each.name: parameters[each.name] for each in fields(JointErrorModel)}
    values["degrees"] = [np.inf if each is None else each for each in values["degrees"]]
    whole = {name: values.pop(name) for name in ("joints", "rate", "power")}
    arrays = {name: np.array(each, float) for name, each in values.items()}
    n, inf = len(whole["joints"]), np.inf
    sizes = {"memory": (n, 3), "mean_gain": (n, len(INPUTS)), "scale": (n, len(GROWTH))}
    ends = {
        "memory": (-inf, inf),
        "mean_gain": (-inf, inf),
        "lag": (-inf, inf),
        "degrees": (2.0, inf),
        "drift": (0, 1),
    }
    for name, array in arrays.items():
        (low, high), size = ends.get(name, (0.0, inf)), sizes.get(name, (n,))
        if array.shape != size or not np.all((low <= array) & (array <= high)):
            rule = f"numbers from {low:g} to {high:g} of shape {size}, got {array.tolist()}"
            raise ModelDomainError(f"parameters.{name} must be {rule}")
    if (power := whole["power"]) != SATURATING and not isinstance(power, int | float):
        message = f"parameters.power must be a number or {SATURATING!r}, got {power!r}"
        raise ModelDomainError(message)
    law = JointErrorModel(**arrays, **whole | {"joints": tuple(whole["joints"])})
    radius = np.abs(np.linalg.eigvals(law.companion())).max()
    if radius > 1 + ROUNDED:
        message = (
            f"parameters.memory is unstable: errors grow {radius:.4g} times a sample"
        )
        raise ModelDomainError(f"{message}; a factor of at most 1 is required")
    return law
