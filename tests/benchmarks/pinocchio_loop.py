"""The take of an arm in space filtered as one would with Pinocchio: a loop over the particles."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from measured_take import Take


class PinocchioTake(Take):
    """Moved by the exact law of a step, its factors by QR of Jᵀ of one particle at a time; the tip
    is the frame ``tool`` of a ``urdf``.
    """

    def __init__(self, urdf, tool, placements, sigma_b, **told) -> None:
        super().__init__(**told)
        self.model = pin.buildModelFromUrdf(urdf)
        self.data, self.frame = self.model.createData(), self.model.getFrameId(tool)
        self.sigma_b = sigma_b

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(6, n) of one pose (n,)."""
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return pin.computeFrameJacobian(self.model, self.data, q, self.frame, axes)

    def move(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        return np.array([self.moved(pose, command) for pose in q])

    def moved(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """(n,) the next pose of one particle."""
        axes, upper = np.linalg.qr(self.jacobian(q).T)
        m = len(upper)
        v, w = command[:m], command[m:]
        a, d = np.linalg.solve(upper.T, v), (m + 1) / self.sigma_b**2
        r = np.linalg.norm(a)
        z = d / self.rng.chisquare(d - m + 1)
        t = self.rng.standard_normal(m - 1) / np.sqrt(self.rng.chisquare(d - m + 2))
        mirror = a.copy()
        mirror[0] += np.copysign(r, a[0])
        action = a - (mirror[1:] @ t) / (r + abs(a[0])) * mirror
        action[1:] += r * t
        if len(w) == 0:
            return q + axes @ (z * action)
        return q + w + axes @ (z * action - axes.T @ w)


def filtered(take: PinocchioTake, count: int) -> np.ndarray:
    """(M + 1, n) posterior means of ``count`` particles."""
    q, weights, means = take.start(count), np.full(count, 1 / count), []
    for k in range(len(take.steps) + 1):
        if k > 0:
            q = take.step(k, q)
        if k in take.y:
            weights = weights * np.exp(take.log_likelihood(k, q))
            weights /= weights.sum()
        means.append(weights @ q)
        np.cov(q, rowvar=False, aweights=weights)
        if 1 / np.sum(weights**2) < count / 2:
            comb = (np.arange(count) + take.rng.random()) / count
            chosen = np.searchsorted(np.cumsum(weights), comb).clip(max=count - 1)
            q, weights = q[chosen], np.full(count, 1 / count)
    return np.array(means)
