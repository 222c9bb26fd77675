"""Where the particles start, and the domain that they have to stay in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import SINGULAR_SINE, PlanarChain
from pipeline.arm.interface import Chain
from pipeline.core.compiled import inner
from pipeline.core.errors import DegenerateFilterError, ModelDomainError
from pipeline.filtering.state import Domain


@dataclass(frozen=True)
class Start:
    """The normal law of the first pose, as the training takes have it; it is restricted to D_q."""

    mean: np.ndarray  # (n,) rad
    covariance: np.ndarray  # (n, n) rad², singular allowed


def domain_of(chain: Chain) -> Domain:
    """D_q of ``chain``."""
    planar = isinstance(chain, PlanarChain)
    straight, clearance = (chain.straight, np.arcsin(SINGULAR_SINE)) if planar else (0.0, 0.0)
    lower, upper = (np.array(each, dtype=float) for each in (chain.lower, chain.upper))
    return Domain(lower, upper, straight, float(clearance))


def initial_particles(
    start: Start, chain: Chain, count: int, rng: np.random.Generator, *, take: str
) -> tuple[np.ndarray, int]:
    """(count, n) draws of the start's normal law within the joint limits, and how many draws were
    rejected.

    Raises ModelDomainError for moments that no normal law has, and DegenerateFilterError where
    ``count`` draws in a row lie outside.
    """
    if not (np.isfinite(start.mean).all() and np.isfinite(start.covariance).all()):
        raise ModelDomainError(
            "the mean or covariance of the start poses is not finite; give at least two training "
            "takes",
            take=take,
        )
    variances, axes = np.linalg.eigh(start.covariance)
    # rounding leaves the zero eigenvalues of a singular covariance slightly negative
    if variances[0] < -1e-9 * variances[-1]:
        raise ModelDomainError(
            "the covariance of the start poses has a negative eigenvalue",
            take=take,
            eigenvalue=float(variances[0]),
        )
    root, poses = axes * np.sqrt(np.maximum(variances, 0.0)), np.empty((count, len(variances)))
    accepted = rejected = 0
    while accepted < count:
        normals = rng.standard_normal(poses.shape)
        draws = start.mean + (root * normals[:, None]).sum(axis=-1)
        inside = np.flatnonzero(chain.within_limits(draws) & ~chain.singular(draws))
        if len(inside) == 0:
            raise DegenerateFilterError(
                f"none of {count} start poses lies within the joint limits; compare the training "
                "takes' start with the URDF's limits",
                take=take,
                step=0,
                mean=start.mean.round(4).tolist(),
            )
        rejected += count - len(inside)
        more = inside[: count - accepted]
        poses[accepted : accepted + len(more)] = draws[more]
        accepted += len(more)
    return poses, rejected


@inner
def mark_outside(domain: Domain, q: np.ndarray, outside: np.ndarray) -> bool:
    """Fill ``outside`` (P or more) with 1 where a pose of ``q`` (n, P) is not in D_q and 0 where
    it is; return whether any is not.
    """
    second, any_outside = q[1 if len(q) > 1 else 0], 0.0
    for i in range(len(second)):
        half_turns = (second[i] - domain.straight) * (1 / np.pi)
        bent = np.pi * abs(half_turns - np.floor(half_turns + 0.5)) >= domain.clearance
        outside[i] = 0.0 if bent else 1.0
    for j in range(len(q)):
        angle, low, high = q[j], domain.lower[j], domain.upper[j]
        for i in range(len(angle)):
            within = (low <= angle[i]) & (angle[i] <= high)
            outside[i] = outside[i] if within else 1.0
    for i in range(len(second)):
        any_outside += outside[i]
    return any_outside > 0.0
