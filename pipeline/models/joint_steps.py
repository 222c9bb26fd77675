"""Plain models of a joint step: noise that depends on the commanded step of the joints alone.

    ω_j = s_j(q̇_j)·e_j,   s_j² = r_j² + a_j + b_j|q̇_j|ᵖ,   q̇ the commanded step in rad,

r_j what the recordings resolve, a_j at rest, b_j the gain (0: additive). p = 2 is the speed-scaled
law, whose standard deviation is a share of the step; p = 1 is the distance-scaled law, whose
variance is proportional to the angle travelled, as if each part of the way added noise of its own.
e is normal with correlation R between the joints, or Student's t with ν_j degrees of
freedom for each joint alone. No Jacobian is needed. A gain b_j that the recordings cannot tell is
NaN: a step beyond those that were seen is then refused.
"""

from dataclasses import dataclass, fields
from math import lgamma
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.normal import NormalModel, normal_log_density

KIND = "joint_steps"
BEYOND = 1.05  # of the greatest step seen, up to which a joint of unknown gain is predicted
MIXTURE = np.arange(-24.0, 4.0, 0.1)  # ln of the mixing variable of Student's t
ABSENT = {"gain": np.nan, "degrees": np.inf}  # null in plain values


@dataclass(frozen=True)
class JointStepModel(NormalModel):
    """The law of the next pose of n joints; ``degrees`` are infinite for normal noise."""

    joints: tuple[str, ...]
    resolution: ndarray  # (n,) r in rad
    floor: ndarray  # (n,) a in rad²
    gain: ndarray  # (n,) b; NaN where the recordings cannot tell it
    reach: ndarray  # (n,) greatest commanded step that was seen, rad
    degrees: ndarray  # (n,) ν
    correlation: ndarray  # (n, n) R of normal noise; I for Student's t
    power: float = 2.0  # p

    def scale(self, dq: ndarray) -> ndarray:
        """(..., n) s in rad for commanded steps ``dq`` (..., n) in rad; raises ModelDomainError
        where a gain is unknown and the step of its joint beyond those seen.
        """
        for j in np.flatnonzero(np.isnan(self.gain)):
            most = float(np.abs(dq[..., j]).max(initial=0.0))
            if most > BEYOND * self.reach[j]:
                raise ModelDomainError(
                    f"the noise of {self.joints[j]} at a step of {most:.3g} rad is not known: it "
                    f"moved at most {self.reach[j]:.3g} rad a step in the recordings; record a "
                    "motion in which it moves",
                    joint=self.joints[j],
                )
        return np.sqrt(
            self.resolution**2 + self.floor + np.nan_to_num(self.gain) * np.abs(dq) ** self.power
        )

    def covariance_of_joint_step(self, dq: ndarray) -> ndarray:
        """(..., n, n) rad² for commanded steps ``dq`` (..., n) in rad; refused as :meth:`scale`."""
        degrees = np.where(np.isinf(self.degrees), 4.0, self.degrees)
        wide = np.where(np.isinf(self.degrees), 1.0, degrees / (degrees - 2))
        std = self.scale(dq) * np.sqrt(wide)
        return std[..., :, None] * self.correlation * std[..., None, :]

    def noise_log_density(
        self, dq: ndarray, noise: ndarray, measurement: ndarray | None = None
    ) -> ndarray:
        """(...,) ln p(ω) in rad⁻ⁿ of ``noise`` ω (..., n) in rad at commanded steps ``dq``, with
        ``measurement`` (n, n) in rad² of normal noise on top, which for Student's t must be
        diagonal (ModelDomainError otherwise).
        """
        scale, n = self.scale(dq), len(self.joints)
        measurement = np.zeros((n, n)) if measurement is None else measurement
        if np.isinf(self.degrees).all():
            added = measurement / (scale[..., :, None] * scale[..., None, :])
            covariance = self.correlation + added
            return normal_log_density(noise / scale, covariance) - np.log(scale).sum(axis=-1)
        if np.any(measurement != np.diag(np.diag(measurement))):
            raise ModelDomainError("noise of Student's t takes a diagonal measurement covariance")
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

    def parameters(self) -> dict[str, Any]:
        """Plain values for :func:`build_joint_steps`; null where the recordings tell no number."""
        plain = {each.name: np.asarray(getattr(self, each.name)).tolist() for each in fields(self)}
        for name in ABSENT:
            plain[name] = [each if np.isfinite(each) else None for each in plain[name]]
        return {"kind": KIND} | plain


def build_joint_steps(parameters: dict[str, Any]) -> JointStepModel:
    """Build the model from what :meth:`JointStepModel.parameters` gave."""
    values = {each.name: parameters[each.name] for each in fields(JointStepModel)}
    for name, absent in ABSENT.items():
        values[name] = [absent if each is None else each for each in values[name]]
    joints, power = tuple(values.pop("joints")), float(values.pop("power"))
    arrays = {name: np.array(each, float) for name, each in values.items()}
    return JointStepModel(joints, **arrays, power=power)


def student_log_density(
    noise: ndarray, scale: ndarray, degrees: float, variance: float = 0.0
) -> ndarray:
    """(...) ln density in 1/rad of ``noise``/``scale`` of Student's t with ``degrees`` ν, N(0,
    ``variance``) in rad² added to the noise: a mixture of normals N(0, s²/λ + variance) over
    λ ~ Gamma(ν/2, ν/2), by the trapezoidal rule in ln λ. An infinite ν is the normal law.
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
