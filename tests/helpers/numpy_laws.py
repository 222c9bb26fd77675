"""A step of every motion model in NumPy, from the numbers that the compiled laws draw: what those
are held against.
"""

import numpy as np

from pipeline.models.additive.law import AdditiveModel
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kernel import DRAWN
from pipeline.models.model import frobenius, root
from pipeline.models.wishart.decomposition import split
from pipeline.models.wishart.law import WishartModel
from pipeline.randommatrix.wishart import degrees_of_freedom


def plain_steps(model, chain, q, v, rng) -> tuple[np.ndarray, int]:
    """(P, n) draws of the next poses after ``q`` (P, n) in rad under one command ``v`` or one for
    each, and how many were clipped; a block at a time, as the compiled laws draw.
    """
    commands = np.broadcast_to(v, (len(q), np.shape(v)[-1]))
    draws = []
    clipped = 0
    for first in range(0, len(q), DRAWN):
        block = slice(first, first + DRAWN)
        drawn, clipped_of_block = _block(model, chain, q[block], commands[block], rng)
        draws.append(drawn)
        clipped += clipped_of_block

    return np.concatenate(draws), clipped


def _block(model, chain, q, v, rng) -> tuple[np.ndarray, int]:
    dq = chain.nominal_step(q, v)

    match model:
        case AdditiveModel():
            noise = rng.standard_normal(q.shape) @ root(model.noise)
            return q + dq + noise, 0
        case GaussianModel():
            noise, clipped = _gaussian(model, chain, q, v, rng)
            return q + dq + noise, clipped
        case WishartModel():
            return q + _wishart(model, chain, q, v, rng), 0
    raise TypeError(f"no law of {model}")


def _gaussian(model, chain, q, v, rng) -> tuple[np.ndarray, int]:
    """(P, n) noise w ~ N(0, α²(u² − ‖J⁺‖²)‖v‖²/(mn) I), and how many were clipped."""
    inverse = chain.inverse_jacobian(q)
    norm = frobenius(inverse)
    entries = inverse[0].size
    task = v[:, : len(chain.task)]

    remainder = np.maximum(model.u**2 - norm**2, 0.0)
    scale = model.alpha**2 * remainder / entries
    std = np.sqrt(scale * np.vecdot(task, task))
    noise = std[:, None] * rng.standard_normal(q.shape)
    clipped = np.count_nonzero(norm > model.u)
    return noise, int(clipped)


def _wishart(model, chain, q, v, rng) -> np.ndarray:
    """‖T‖ in closed form: T = N·sqrt((exp(‖N‖²/(d−1)) − 1)/‖N‖²) for N ~ N(0, I₂)."""
    d = degrees_of_freedom(model.sigma_b, 3)
    if model.decomposition.name == "qr_transposed":
        # J = LQ: the step is Qᵀ·B⁻¹·L⁻¹v
        jacobian = chain.jacobian(q)
        lower = np.linalg.cholesky(jacobian @ jacobian.swapaxes(1, 2))
        orthonormal = np.linalg.solve(lower, jacobian)
        a = np.linalg.solve(lower, v[..., None])[..., 0]
        back = orthonormal.mT
    else:
        a, back, _ = split(chain.jacobian(q), v, model.decomposition)

    z = d / rng.chisquare(d - 2, len(q))
    normal = rng.standard_normal((len(q), 2))
    square = np.vecdot(normal, normal)
    stretch = np.sqrt(np.expm1(square / (d - 1)) / square)
    tangent = np.zeros(q.shape)
    tangent[:, 1:] = normal * stretch[:, None]

    # the reflection that takes the first axis to ±a/r
    r = np.sqrt(np.vecdot(a, a))
    mirror = a.copy()
    mirror[:, 0] += np.copysign(r, a[:, 0])
    reach = r + np.abs(a[:, 0])
    along = np.vecdot(mirror, tangent) / np.where(reach > 0, reach, 1.0)
    action = z[:, None] * (a + r[:, None] * tangent - along[:, None] * mirror)
    return np.matvec(back, action)
