"""Fit of the plain models of a joint step to recorded steps of any motions by maximum likelihood,
and the parameters that the steps cannot tell.

A gain b_j has a number if at least :data:`LEAST_STEPS` steps of the joint are at least
:data:`LEAST_SHARE` of the reference step, the greatest commanded step of any joint, and if the
variance predicted at the reference step has a standard error of at most :data:`BOUND` of itself.
The standard error is that of the Fisher information of (a_j, b_j), ½Σ V⁻²[1, |q̇|ᵖ; |q̇|ᵖ, q̇²ᵖ]
for normal noise, divided by (kurtosis − 1)/2 as tails tell less, and times ν/(ν + 3) for Student's
t; steps count as independent.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_steps import JointStepModel

LEAST_STEPS, LEAST_SHARE, BOUND = 20, 0.1, 0.5
UNRESOLVED = 1e-2  # of a joint's rms noise, below which noise counts as not resolved
DEGREES = (3.0, 100.0)  # of ν: below the variance is decided by few steps, above it is normal
# model → power p of the step by which its variance grows, 0 where it does not, True where it has
# Student's tails
PLAIN = {
    "additive_all": (0.0, False),
    "scaled_all": (2.0, False),
    "distance_all": (1.0, False),
    "additive_t": (0.0, True),
    "scaled_t": (2.0, True),
    "distance_t": (1.0, True),
}


class JointStepFit(NamedTuple):
    """A fitted model; ``untold`` are (parameter, joint, found, required) without a number."""

    model: JointStepModel
    untold: Sequence[tuple[str, str, str, str]]


class _Noise(NamedTuple):
    """Noise of one joint, and how its variance V = least² + a + b·grown goes with the step."""

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
    """Fit the model ``name`` of :data:`PLAIN` to commanded steps ``dq`` and ``noise`` ω (N, n) in
    rad, the measured minus the commanded step, of n ``joints``; ``pose_noise`` is the stated
    standard deviation of a measured angle in rad, ``start`` a fit at which the search begins.
    Raises ModelDomainError where there is no noise at all or no step.
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
        # a hundredth of the identity keeps joints that move as one from a singular law
        correlation = 0.99 * moment / np.outer(std, std) + 0.01 * np.eye(len(joints))
        model = replace(model, correlation=correlation)
    return JointStepFit(model, untold)


def _fit_joint(
    noise: _Noise, scaled: bool, start: tuple[float, float, float] | None = None
) -> tuple[float, float, float]:
    """a in rad², b and ν of one joint's ``noise``."""
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
    """−mean ln p but for a constant of normal noise, and its slopes by ln a, ln b and ln ν."""
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
    """Standard error of the variance where |q̇|ᵖ is ``reference``, as a share of it."""
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
