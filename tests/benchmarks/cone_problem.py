"""(BsampOpt) handed to the solver Clarabel as the cone problem that it is, without CVXPY between: a
user who knows the cones.

The unknowns are the bounds t₁, t₂ of the two norms, and the upper triangle of S column by column,
what is off the diagonal times √2, so that its norm is that of S.
"""

from __future__ import annotations

import clarabel
import numpy as np
from scipy import sparse


class ConeProblem:
    """min w₁‖ω − J₂⁻¹Sa‖ + w₂‖S‖_F over symmetric S (m, m) with S + I ⪰ floor·I."""

    def __init__(self, weights: tuple[float, float], m: int, floor: float) -> None:
        self.columns, self.rows = np.tril_indices(m)  # of the upper triangle, column by column
        self.scale = np.where(self.rows == self.columns, 0.5, np.sqrt(0.5))
        size = len(self.rows)
        self.objective = np.array([*weights, *np.zeros(size)])
        self.none = sparse.csc_matrix((2 + size, 2 + size))
        one = -np.eye(2 + size)
        # below the first cone of m + 1 rows: ‖S‖_F ≤ t₂, and S + (1 − floor)·I semidefinite
        self.below = np.vstack([one[1:], one[2:]])
        right = (1 - floor) * (self.rows == self.columns)
        self.right = np.concatenate([np.zeros(1 + size), right])
        second = clarabel.SecondOrderConeT
        self.cones = [second(m + 1), second(1 + size), clarabel.PSDTriangleConeT(m)]
        self.settings = clarabel.DefaultSettings()
        self.settings.verbose = False

    def __call__(self, noise: np.ndarray, a: np.ndarray, back: np.ndarray) -> float:
        """The least value for ω (m,), a (m,) and J₂⁻¹ (m, m)."""
        pairs = back[:, self.rows] * a[self.columns] + back[:, self.columns] * a[self.rows]
        first = np.zeros((len(noise) + 1, len(self.objective)))
        first[0, 0], first[1:, 2:] = -1.0, pairs * self.scale
        matrix = sparse.csc_matrix(np.vstack([first, self.below]))
        right = np.concatenate([[0.0], noise, self.right])
        arguments = (self.none, self.objective, matrix, right, self.cones, self.settings)
        return clarabel.DefaultSolver(*arguments).solve().obj_val
