"""Plain models of a joint step, whose noise depends only on the commanded joint step, and their
maximum-likelihood fit to recorded steps of any motions.

    ω_j = s_j(q̇_j)·e_j,   s_j² = r_j² + a_j + b_j|q̇_j|ᵖ,   q̇ the commanded step in rad,

r_j is the resolution of the recordings, a_j the variance at rest, b_j the gain (0: additive). p = 2
is the speed-scaled law, whose standard deviation is a share of the step. p = 1 is the
distance-scaled law: the variance is proportional to the angle travelled, as if each part of the way
added independent noise. e is normal with correlation R between the joints, or independent Student's
t with ν_j degrees of freedom. No Jacobian is needed.

The reference step is the greatest commanded step of any joint. A gain b_j is estimated if at least
:data:`LEAST_STEPS` steps of the joint are at least :data:`LEAST_SHARE` of the reference step, and
the relative standard error of the variance at the reference step is at most :data:`BOUND`.
Otherwise b_j is NaN, and steps beyond the recorded ones raise ModelDomainError. The standard error
follows from the Fisher information of (a_j, b_j), ½Σ V⁻²[1, |q̇|ᵖ; |q̇|ᵖ, q̇²ᵖ] for normal noise,
divided by (kurtosis − 1)/2, or times ν/(ν + 3) for Student's t. Steps are assumed independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import lgamma
from typing import ClassVar, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import NormalModel, Traits, normal_log_density

BEYOND = 1.05  # times the greatest recorded step: limit of predictions for an unknown gain
MIXTURE = np.arange(-24.0, 4.0, 0.1)  # ln of the mixing variable of Student's t
LEAST_STEPS, LEAST_SHARE, BOUND = 20, 0.1, 0.5
UNRESOLVED = 1e-2  # share of a joint's rms noise that is taken as the resolution
DEGREES = (3.0, 100.0)  # bounds of ν: below 3 few steps set the variance, above 100 is normal
# model → power p of the step by which its variance grows (0: constant), True for Student's tails
PLAIN = {
    "additive_all": (0.0, False),
    "scaled_all": (2.0, False),
    "distance_all": (1.0, False),
    "additive_t": (0.0, True),
    "scaled_t": (2.0, True),
    "distance_t": (1.0, True),
}


@dataclass(frozen=True)
class JointStepModel(NormalModel):
    """Law of the next pose of n joints; ``degrees`` are infinite for normal noise."""

    traits: ClassVar = Traits(noisy_at_rest=True, needs_jacobian=False, compiled=False)
    joints: tuple[str, ...]
    resolution: ndarray  # (n,) r in rad
    floor: ndarray  # (n,) a in rad²
    gain: ndarray  # (n,) b; NaN if the recordings do not determine it
    reach: ndarray  # (n,) greatest recorded commanded step, rad
    degrees: ndarray  # (n,) ν
    correlation: ndarray  # (n, n) R of normal noise; I for Student's t
    power: float = 2.0  # p

    def scale(self, dq: ndarray) -> ndarray:
        """Noise scale s (..., n) in rad for commanded steps ``dq`` (..., n) in rad. Raises
        ModelDomainError if a joint of unknown gain moves farther than in the recorded steps.
        """
        for j in np.flatnonzero(np.isnan(self.gain)):
            most = float(np.abs(dq[..., j]).max(initial=0.0))
            if most > BEYOND * self.reach[j]:
                raise ModelDomainError(
                    f"the noise of {self.joints[j]} at a step of {most:.3g} rad is not known: it "
                    f"moved at most {self.reach[j]:.3g} rad a step in the recordings; record a "
                    "motion in which it moves faster",
                    joint=self.joints[j],
                )
        growth = np.nan_to_num(self.gain) * np.abs(dq) ** self.power
        return np.sqrt(self.resolution**2 + self.floor + growth)

    def covariance_of_joint_step(self, dq: ndarray) -> ndarray:
        """(..., n, n) covariance in rad² for commanded steps ``dq`` (..., n) in rad; raises as
        :meth:`scale`.
        """
        degrees = np.where(np.isinf(self.degrees), 4.0, self.degrees)
        wide = np.where(np.isinf(self.degrees), 1.0, degrees / (degrees - 2))
        std = self.scale(dq) * np.sqrt(wide)
        return std[..., :, None] * self.correlation * std[..., None, :]

    def noise_log_density(
        self, dq: ndarray, noise: ndarray, measurement: ndarray | None = None
    ) -> ndarray:
        """(...,) ln p in rad⁻ⁿ of ``noise`` (..., n) in rad at commanded steps ``dq``: ω plus
        normal noise of covariance ``measurement`` (n, n) in rad². Raises ModelDomainError for
        Student's t with a ``measurement`` that is not diagonal.
        """
        scale, n = self.scale(dq), len(self.joints)
        measurement = np.zeros((n, n)) if measurement is None else measurement
        if np.isinf(self.degrees).all():
            added = measurement / (scale[..., :, None] * scale[..., None, :])
            covariance = self.correlation + added
            return normal_log_density(noise / scale, covariance) - np.log(scale).sum(axis=-1)
        if np.any(measurement != np.diag(np.diag(measurement))):
            raise ModelDomainError("Student's t noise requires a diagonal measurement covariance")
        joints = [np.moveaxis(each, -1, 0) for each in (noise, scale)]
        each = zip(*joints, self.degrees, np.diag(measurement), strict=True)
        return np.sum([student_log_density(*one) for one in each], axis=0)

    def noise_sample(self, dq: ndarray, rng: Generator) -> ndarray:
        """(..., n) draws of ω in rad at commanded steps ``dq`` (..., n) in rad."""
        scale = self.scale(dq)
        white = rng.standard_normal(scale.shape) @ np.linalg.cholesky(self.correlation).T
        for j in np.flatnonzero(np.isfinite(self.degrees)):
            chi = rng.chisquare(self.degrees[j], scale.shape[:-1])
            white[..., j] *= np.sqrt(self.degrees[j] / chi)
        return scale * white

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        return self.covariance_of_joint_step(chain.nominal_step(q, v))

    def sample(self, chain: Mechanism, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        dq = np.broadcast_to(chain.nominal_step(q, v), np.shape(q))
        return q + dq + self.noise_sample(dq, rng)

    def log_density(
        self, chain: Mechanism, q: ndarray, v: ndarray, q_next: ndarray, measurement=None
    ) -> ndarray:
        dq = chain.nominal_step(q, v)
        return self.noise_log_density(dq, q_next - q - dq, measurement)


def student_log_density(
    noise: ndarray, scale: ndarray, degrees: float, variance: float = 0.0
) -> ndarray:
    """(...) log density in 1/rad of ``noise``, Student's t of ``scale`` and ``degrees`` ν plus N(0,
    ``variance``) in rad². It is a mixture of normals N(0, s²/λ + variance) over λ ~ Gamma(ν/2,
    ν/2), by the trapezoidal rule in ln λ. An infinite ν is the normal law.
    """
    if np.isinf(degrees):
        total = scale**2 + variance
        return -0.5 * (np.log(2 * np.pi * total) + noise**2 / total)
    if variance == 0.0:
        constant = lgamma((degrees + 1) / 2) - lgamma(degrees / 2) - 0.5 * np.log(degrees * np.pi)
        tail = (degrees + 1) / 2 * np.log1p((noise / scale) ** 2 / degrees)
        return constant - np.log(scale) - tail
    log_weight = degrees / 2 * (MIXTURE - np.exp(MIXTURE))
    log_weight -= np.log(np.exp(log_weight - log_weight.max()).sum()) + log_weight.max()
    total = scale[..., None] ** 2 * np.exp(-MIXTURE) + variance
    terms = log_weight - 0.5 * (np.log(2 * np.pi * total) + noise[..., None] ** 2 / total)
    most = terms.max(axis=-1)
    return most + np.log(np.exp(terms - most[..., None]).sum(axis=-1))


class JointStepFit(NamedTuple):
    """Model; ``untold`` lists parameters without an estimate: (name, joint, found, required)."""

    model: JointStepModel
    untold: Sequence[tuple[str, str, str, str]]


class _Noise(NamedTuple):
    """Noise of one joint with the variance V = least² + a + b·grown."""

    w: ndarray  # (N,) ω in rad
    grown: ndarray  # (N,) |q̇|ᵖ
    least: float  # rad
    student: bool


def fit_joint_steps(
    name: str,
    dq: ndarray,
    noise: ndarray,
    joints: Sequence[str],
    *,
    pose_noise: float = 0.0,
    start: JointStepModel | None = None,
) -> JointStepFit:
    """Fit the model ``name`` of :data:`PLAIN` to commanded steps ``dq`` (N, n) in rad of n
    ``joints`` and ``noise`` ω (N, n), the measured minus the commanded step. ``pose_noise`` is the
    standard deviation of a measured angle in rad, ``start`` a fit at which the search begins.
    Raises ModelDomainError without steps or noise.
    """
    power, student = PLAIN[name]
    rms = np.sqrt(np.mean(noise**2, axis=0)) if len(noise) else np.zeros(len(joints))
    if not np.all(np.isfinite(rms)) or not np.any(rms > 0):
        raise ModelDomainError("the recorded steps have no noise", steps=len(noise))
    resolved = UNRESOLVED * np.maximum(rms, UNRESOLVED * rms.max())
    least = np.sqrt(resolved**2 + 2 * pose_noise**2)
    reach, reference = np.abs(dq).max(axis=0), float(np.abs(dq).max())
    rows, untold = [], []
    for j, joint in enumerate(joints):
        x = np.abs(dq[:, j])
        of_joint = _Noise(noise[:, j], x**power, least[j], student)
        first = None if start is None else (start.floor[j], start.gain[j], start.degrees[j])
        a, b, nu = _fit_joint(of_joint, power > 0, first)
        if power > 0:
            moved = int(np.sum(x >= LEAST_SHARE * reference))
            relative = _relative_error(of_joint, a, b, nu, reference**power)
            if moved < LEAST_STEPS or not relative <= BOUND:
                (a, _, nu), b = _fit_joint(of_joint, False), np.nan
                found = f"standard error {relative:.2g} of the variance at {reference:.2g} rad"
                if moved < LEAST_STEPS:
                    found = f"{moved} steps of at least {LEAST_SHARE * reference:.2g} rad"
                required = f"{LEAST_STEPS} steps, standard error ≤ {BOUND}"
                untold.append(("gain", joint, found, required))
        if student and nu <= DEGREES[0] * 1.001:
            found = f"the likelihood is highest at the least value, {DEGREES[0]:g}, which is used"
            untold.append(("degrees of freedom", joint, found, f"above {DEGREES[0]:g}"))
        rows.append((a, b, nu))
    floor, gain, degrees = np.array(rows).T
    shape = (floor, gain, reach, degrees, np.eye(len(joints)), power or 2.0)
    model = JointStepModel(tuple(joints), least, *shape)
    z = noise / model.scale(dq)
    moment = z.T @ z / len(z)
    std = np.sqrt(np.diag(moment))
    if not student and np.all(std > 0):
        # 1 % of the identity keeps R of joints that move together from being singular
        correlation = 0.99 * moment / np.outer(std, std) + 0.01 * np.eye(len(joints))
        model = replace(model, correlation=correlation)
    return JointStepFit(model, untold)


def _fit_joint(
    noise: _Noise, scaled: bool, start: tuple[float, float, float] | None = None
) -> tuple[float, float, float]:
    """Return a in rad², b and ν fitted to the ``noise`` of one joint."""
    from scipy.optimize import minimize

    w, grown, least, student = noise
    unit, pace = max(float(np.mean(w**2)), least**2), max(float(np.mean(grown)), 1e-300)
    floor, scaled = least**2 / unit, scaled and pace > 1e-300
    used, begin = np.array([True, scaled, student]), np.log([0.5, 0.5, 5.0])
    bounds = np.array([(np.log(1e-3 * floor), 9.0), (np.log(1e-6), 14.0), np.log(DEGREES)])
    if start is not None:
        known = np.array(start) * (1 / unit, pace / unit, 1)
        usable = np.isfinite(known) & (known > 0)
        logarithms = np.log(np.where(usable, known, 1.0))
        begin = np.where(usable, np.clip(logarithms, *bounds.T), begin)
    steps = w**2 / unit, grown / pace, floor, scaled, student
    search = {"jac": True, "method": "L-BFGS-B", "bounds": bounds[used]}
    values = np.exp(minimize(_negative_log_likelihood, begin[used], steps, **search).x)
    a, b = values[0] * unit, values[1] * unit / pace if scaled else 0.0
    nu = float(values[-1]) if student else np.inf
    return float(a), float(b), np.inf if nu >= 0.999 * DEGREES[1] else nu


def _negative_log_likelihood(
    theta: ndarray, w2: ndarray, grown: ndarray, floor: float, scaled: bool, student: bool
) -> tuple[float, ndarray]:
    """−mean ln p up to a constant, and its derivatives by ln a, ln b and ln ν."""
    a, b = np.exp(theta[0]), np.exp(theta[1]) if scaled else 0.0
    variance = floor + a + b * grown
    z = w2 / variance
    if student:
        from scipy.special import digamma, gammaln

        nu = np.exp(theta[-1])
        value = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu)
        value += np.mean(-0.5 * np.log(variance) - (nu + 1) / 2 * np.log1p(z / nu))
        slope = (-0.5 + (nu + 1) / 2 * z / (nu + z)) / variance
        by_nu = 0.5 * (digamma((nu + 1) / 2) - digamma(nu / 2) - 1 / nu)
        by_nu += np.mean(-0.5 * np.log1p(z / nu) + (nu + 1) * z / (2 * nu * (nu + z)))
    else:
        value = np.mean(-0.5 * np.log(variance) - 0.5 * z)
        slope = 0.5 * (z - 1) / variance
    slopes = [a * slope.mean()]
    slopes += [b * np.mean(slope * grown)] if scaled else []
    slopes += [nu * by_nu] if student else []
    return -float(value), -np.array(slopes)


def _relative_error(noise: _Noise, a: float, b: float, nu: float, reference: float) -> float:
    """Relative standard error of the variance at |q̇|ᵖ = ``reference``."""
    w, grown, least, _ = noise
    variance = least**2 + a + b * grown
    z2 = w**2 / variance
    kurtosis = np.mean(z2**2) / np.mean(z2) ** 2
    tails = nu / (nu + 3) if np.isfinite(nu) else 2 / max(float(kurtosis) - 1, 2.0)
    rows = np.stack([1 / variance, grown / reference / variance])
    information = 0.5 * tails * rows @ rows.T
    scale = np.sqrt(np.diag(information))
    if not np.all(scale > 0) or np.linalg.cond(information / np.outer(scale, scale)) > 1e12:
        return np.inf
    errors = np.linalg.inv(information)
    return float(np.sqrt(errors.sum()) / (least**2 + a + b * reference))
