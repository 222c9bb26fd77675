"""Steps of the Wishart model by QR of Jᵀ of an arm of n revolute joints whose task is the whole
pose of its tip: kinematics, factors and the exact law of a step, each number of all
particles at once.
"""

from __future__ import annotations

import numpy as np
from measured_take import Take

ROWS = 6  # m


class SpatialTake(Take):
    """A motion of an arm in space."""

    def __init__(self, law, placements, sigma_b, **told) -> None:
        super().__init__(**told)
        assert law == "closed form"
        placements = np.array(placements)  # (n + 1, 12)
        self.turns, self.ways = placements[:, :9].reshape(-1, 3, 3), placements[:, 9:]
        self.d = (ROWS + 1) / sigma_b**2

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(6, n, P) rows of velocity and angular velocity, the particles last."""
        joints, count = q.shape[1], len(q)
        sine, cosine = np.sin(q.T), np.cos(q.T)
        turned, point = np.repeat(np.eye(3)[:, :, None], count, axis=2), np.zeros((3, count))
        axes, points = np.empty((2, joints, 3, count))
        for j in range(joints):
            point = point + np.einsum("ikp,k->ip", turned, self.ways[j])
            turned = np.einsum("ikp,kj->ijp", turned, self.turns[j])
            axes[j], points[j] = turned[:, 2], point
            turned[:, 0], turned[:, 1] = (
                turned[:, 0] * cosine[j] + turned[:, 1] * sine[j],
                turned[:, 1] * cosine[j] - turned[:, 0] * sine[j],
            )
        way = point + np.einsum("ikp,k->ip", turned, self.ways[joints]) - points
        jacobian = np.empty((ROWS, joints, count))
        for row, (y, z) in enumerate(((1, 2), (2, 0), (0, 1))):
            jacobian[row] = axes[:, y] * way[:, z] - axes[:, z] * way[:, y]
            jacobian[3 + row] = axes[:, row]
        return jacobian

    def move(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """q + w + Qᵀ(B⁻¹L⁻¹v − Qw), J = LQ, of the ``command`` v, or v and w."""
        lower, rows = factorised(self.jacobian(q))
        step = self.inverse_action(solved(lower, command[:ROWS]))
        if len(command) == ROWS:
            return q + np.einsum("rjp,rp->pj", rows, step)
        w = command[ROWS:]
        return q + w + np.einsum("rjp,rp->pj", rows, step - np.einsum("rjp,j->rp", rows, w))

    def inverse_action(self, a: np.ndarray) -> np.ndarray:
        """(6, P) B⁻¹a = r·R·[z, zT] of ``a`` (6, P): two χ² and five normals a particle, no matrix
        drawn.
        """
        d, count = self.d, a.shape[1]
        r = np.sqrt((a * a).sum(axis=0))
        z = d / self.rng.chisquare(d - ROWS + 1, count)
        t = self.rng.standard_normal((ROWS - 1, count))
        t /= np.sqrt(self.rng.chisquare(d - ROWS + 2, count))
        # R by the Householder reflection that takes the first axis to ±a/r
        mirror = a.copy()
        mirror[0] += np.copysign(r, a[0])
        action = a - (mirror[1:] * t).sum(axis=0) / (r + np.abs(a[0])) * mirror
        action[1:] += r * t
        return z * action


def factorised(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L (6, 6, P) and Q (6, n, P), in its place, of J = LQ of all J (6, n, P), by Gram–Schmidt."""
    lower = np.zeros((ROWS, ROWS, jacobian.shape[2]))
    for r, row in enumerate(jacobian):
        for s in range(r):
            lower[r, s] = np.einsum("jp,jp->p", row, jacobian[s])
            row -= lower[r, s] * jacobian[s]
        lower[r, r] = np.sqrt(np.einsum("jp,jp->p", row, row))
        row /= lower[r, r]
    return lower, jacobian


def solved(lower: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(6, P) solutions of Lx = ``v`` (6,)."""
    x = np.empty(lower.shape[1:])
    for r in range(ROWS):
        x[r] = (v[r] - np.einsum("sp,sp->p", lower[r, :r], x[:r])) / lower[r, r]
    return x
