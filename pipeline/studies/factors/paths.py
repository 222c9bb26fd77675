"""Random straight paths in the joints, driven to and fro at one speed, that an arm can drive within
its limits and under the published bound on ‖J⁻¹‖.

The paper gives neither its path nor the place of its task. Both ends are uniform within the joint
limits; obstacles, the arm itself among them, are left out. The spreads of the models along a path
are the same on the way to and on the way back, so that one way stands for both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Legendre

from pipeline.arm.chain import PlanarChain
from pipeline.models.norm import frobenius


@dataclass(frozen=True)
class Paths:
    """P paths at K poses each, from one end to the other."""

    q: np.ndarray  # (P, K, n) rad
    step: np.ndarray  # (P, n) rad, of every step where the fastest joint moves at its speed limit
    norm: np.ndarray  # (P, K) ‖J⁻¹‖_F, 1/m and 1 mixed


def with_tool(chain: PlanarChain, length: float) -> PlanarChain:
    """``chain`` with its last link of another ``length`` in m, in the same direction."""
    links = chain.links.copy()
    links[-1] *= length / chain.lengths[-1]
    return replace(chain, links=links)


def quadrature(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (K,) from 0 to 1 with both ends, and weights (K,) that add to 1: Gauss–Lobatto, for
    means over a path at one speed.
    """
    last = Legendre.basis(nodes - 1)
    places = np.concatenate([[-1.0], np.sort(last.deriv().roots().real), [1.0]])
    weights = 1 / (nodes * (nodes - 1) * last(places) ** 2)
    return (1 + places) / 2, weights


def draw_paths(
    chain: PlanarChain,
    rate: float,
    u: float,
    candidates: int,
    places: np.ndarray,
    rng: np.random.Generator,
) -> Paths:
    """Those of ``candidates`` random paths whose poses all keep ‖J⁻¹‖_F below ``u``.

    The paper's û is the greatest norm on its path plus some ũ > 0 that it does not give: the norm
    has no lower bound here.

    Args:
        chain: the arm, with its limits.
        rate: steps a second.
        u: published bound, 1/m and 1 mixed.
        candidates: how many are drawn.
        places: (K,) of the poses on a path, 0 and 1 its ends.
        rng: what draws.
    """
    start, end = rng.uniform(chain.lower, chain.upper, (2, candidates, len(chain.lower)))
    q = start[:, None] + places[:, None] * (end - start)[:, None]
    regular = ~chain.singular(q).any(axis=1)
    q, way = q[regular], (end - start)[regular]
    norm = frobenius(chain.inverse_jacobian(q))
    kept = np.all(norm < u, axis=1)
    seconds = np.max(np.abs(way[kept]) / chain.max_speed, axis=1)
    step = way[kept] / (rate * seconds)[:, None]
    return Paths(q[kept], step, norm[kept])
