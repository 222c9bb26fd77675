"""Straight paths that the laboratory's arm may be told to repeat, and how well each lets a swaying
tool have the published covariance of the process noise.

Of the published numbers the covariance Σ̂_ω of the additive noise and the bound û enter here, and
no other: σ̂_B and α̂ stay unseen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from pipeline.arm.chain import PlanarChain
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.laboratory.swing import desired_joints
from pipeline.models.norm import frobenius

PLACES = np.linspace(0.0, 1.0, 9)  # of a path or a segment at which it is held against the limits
OPENING = 0.05  # m, by which the motion extends the arm at least
FLOOR = 0.03  # m, height of every joint and of the tool above what the arm stands on
LEVEL = 0.06  # m, by which the tool's tip is above or below the first joint
APART = 0.09  # m, from the tool to the first link: both have a girth
COLUMN = 0.10  # m, half the width of what no part of the arm may be in, below the first joint
HAND = 0.15  # share of the tool's segment that lies in the wrist
CORRELATION = 4.0  # weight of the correlations against the logarithms of the sizes


def candidates(
    chain: PlanarChain, way: float, u: float, draws: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (P, n) in rad of those of ``draws`` random paths that the arm can take: within its
    joint limits and ‖J⁻¹‖_F ≤ ``u``, opening, clear of itself, its stand and the floor, its tip
    never level with the first joint. Every joint turns by ``way`` in rad.
    """
    n = len(chain.lower)
    sense = rng.choice([-1.0, 1.0], (draws, n))
    start = chain.lower + rng.random((draws, n)) * (chain.upper - chain.lower)
    end = start + way * sense
    inside = chain.within_limits(end)
    start, end = start[inside], end[inside]
    nodes = chain.points(start[:, None] + PLACES[:, None] * (end - start)[:, None])
    tip = nodes[:, :, -1] - chain.origin
    reach = np.hypot(tip[..., 0], tip[..., 1])
    free = (reach[:, -1] > reach[:, 0] + OPENING) & (nodes[..., 1].min(axis=(1, 2)) >= FLOOR)
    free &= np.abs(tip[..., 1]).min(axis=1) >= LEVEL
    start, end, nodes = start[free], end[free], nodes[free]
    free = _clear(chain, nodes)
    start, end = start[free], end[free]
    q = start[:, None] + PLACES[:, None] * (end - start)[:, None]
    free = ~chain.singular(q).any(axis=1)
    start, end, q = start[free], end[free], q[free]
    free = frobenius(chain.inverse_jacobian(q)).max(axis=1) <= u
    return start[free], end[free]


def _clear(chain: PlanarChain, nodes: np.ndarray) -> np.ndarray:
    """(P,) whether the arm is clear of itself and its stand at all ``nodes`` (P, K, n + 1, 2)."""
    segments = [
        nodes[:, :, None, j] + PLACES[:, None] * (nodes[:, :, None, j + 1] - nodes[:, :, None, j])
        for j in range(nodes.shape[2] - 1)
    ]
    points = np.concatenate(segments, axis=2)
    low = points[..., 1] < chain.origin[1] - 0.01
    stand = (low & (np.abs(points[..., 0] - chain.origin[0]) < COLUMN)).any(axis=(1, 2))
    last = nodes[:, :, None, -1] - nodes[:, :, None, -2]
    tool = nodes[:, :, None, -2] + (HAND + (1 - HAND) * PLACES[:, None]) * last
    gap = np.linalg.norm(segments[0][:, :, :, None] - tool[:, :, None], axis=-1)
    return (gap.min(axis=(1, 2, 3)) >= APART) & ~stand


def shares(
    chain: PlanarChain,
    motion: TrajectoryOptions,
    start: np.ndarray,
    end: np.ndarray,
    exponent: float,
) -> np.ndarray:
    """(n, n, n) mean over the motion's steps of J⁻¹e_i e_iᵀJ⁻ᵀ times the speed's power, for each
    task row i: what a unit variance of the sway along it gives Σ_ω.
    """
    t = (np.arange(round(motion.duration * motion.rate)) + 0.5) / motion.rate
    q, speed = desired_joints(t, replace(motion, folded=tuple(start), extended=tuple(end)))
    pace = np.linalg.norm(speed, axis=1) / np.linalg.norm(chain.max_speed)
    inverse = chain.inverse_jacobian(q)
    weight = pace ** (2 * exponent) / len(t)
    return np.einsum("tji,tki,t->ijk", inverse, inverse, weight)


def misfit(share: np.ndarray, published: np.ndarray, most: float) -> float:
    """How far a sway along the task rows with ``share`` (n, n, n) and a clearance of the last
    joint, at ``most`` that part of its published variance, stay from ``published`` Σ̂_ω (n, n):
    least sum of squares of the correlations' distances, times CORRELATION, and the sizes'
    logarithms.
    """
    size = np.sqrt(np.diag(published))
    pairs = np.triu_indices(len(size), 1)
    wanted = (published / np.outer(size, size))[pairs]

    def distances(x: np.ndarray) -> np.ndarray:
        modelled = np.einsum("i,ijk->jk", np.exp(2 * x[:-1]), share)
        modelled[-1, -1] += x[-1] * published[-1, -1]
        spread = np.sqrt(np.diag(modelled))
        correlation = (modelled / np.outer(spread, spread))[pairs]
        return np.concatenate([CORRELATION * (correlation - wanted), np.log(spread / size)])

    # a sway of which each row alone would give the published sizes
    alone = np.log(np.mean(size**2 / np.diagonal(share, axis1=1, axis2=2), axis=1)) / 2
    fits = [
        least_squares(
            distances,
            np.append(np.where(np.arange(len(size)) == row, alone, alone - 2.0), 0.9 * most),
            bounds=([*[-np.inf] * len(size), 0.0], [*[np.inf] * len(size), most]),
        )
        for row in range(len(size))
    ]
    return 2 * min(fit.cost for fit in fits)
