"""The Wishart model of a planar arm as a user of another library would write it, all particles at
once: the exact law of a step, and the paper's Algorithm 1.
"""

from __future__ import annotations

import numpy as np
from arm_in_space import SpatialTake
from measured_take import Take
from scipy import linalg, stats


def take_of(law, **told) -> Take:
    """The take of `scenario.Take.told`, moved by ``law``."""
    return (WishartTake if "links" in told else SpatialTake)(law, **told)


class WishartTake(Take):
    """A motion of a planar arm of three joints."""

    def __init__(self, law, links, signs, sigma_b, **told) -> None:
        super().__init__(**told)
        laws = {"closed form": self.closed_form, "Algorithm 1": self.algorithm_1}
        self.move = laws[law]
        self.links, self.signs = np.array(links), np.array(signs)
        self.d = 4 / sigma_b**2  # (n + 1)/σ_B²

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(P, 3, 3) rows x, z, φ."""
        heading = np.cumsum(q * self.signs, axis=1)
        sine, cosine = np.sin(heading), np.cos(heading)
        x = cosine * self.links[:, 0] + sine * self.links[:, 1]
        z = cosine * self.links[:, 1] - sine * self.links[:, 0]
        jacobian = np.empty((len(q), 3, 3))
        # each joint turns all that comes after it
        jacobian[:, 0] = self.signs * np.cumsum(z[:, ::-1], axis=1)[:, ::-1]
        jacobian[:, 1] = -self.signs * np.cumsum(x[:, ::-1], axis=1)[:, ::-1]
        jacobian[:, 2] = self.signs
        return jacobian

    def closed_form(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """B⁻¹a = r·R·[z, zT]: two χ² and two normals a particle."""
        d, count = self.d, len(q)
        upper, a = eliminated(self.jacobian(q), v)
        r = np.sqrt((a * a).sum(axis=0))
        z = d / self.rng.chisquare(d - 2, count)
        second, third = self.rng.standard_normal((2, count)) / np.sqrt(
            self.rng.chisquare(d - 1, count)
        )
        # R by the Householder reflection that takes the first axis to ±a/r
        mirror = a.copy()
        mirror[0] += np.copysign(r, a[0])
        along = (mirror[1] * second + mirror[2] * third) / (r + np.abs(a[0]))
        action = a - along * mirror
        action[1] += r * second
        action[2] += r * third
        return q + back_substituted(upper, z * action).T

    def algorithm_1(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Draw B, solve J₁BJ₂q̇ = v: the paper's steps by the libraries' functions."""
        first, second = linalg.lu(self.jacobian(q), permute_l=True)
        b = stats.wishart.rvs(self.d, np.eye(3) / self.d, size=len(q), random_state=self.rng)
        right = np.broadcast_to(v, q.shape)[..., None]
        return q + np.linalg.solve(first @ b @ second, right)[..., 0]


def eliminated(jacobian: np.ndarray, v: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Rows of U, each (3, P), and a = J₁⁻¹v (3, P) of the LU decomposition with partial pivoting of
    all J (P, 3, 3) at once.
    """
    rows = np.empty((3, 4, len(jacobian)))
    rows[:, :3] = jacobian.transpose(1, 2, 0)
    rows[:, 3] = v[:, None]
    pivot = np.abs(rows[:, 0]).argmax(axis=0)
    first = np.where(pivot == 0, rows[0], np.where(pivot == 1, rows[1], rows[2]))
    second = np.where(pivot == 1, rows[0], rows[1])
    third = np.where(pivot == 2, rows[0], rows[2])
    second = second - second[0] / first[0] * first
    third = third - third[0] / first[0] * first
    exchanged = np.abs(third[1]) > np.abs(second[1])
    second, third = np.where(exchanged, third, second), np.where(exchanged, second, third)
    third = third - third[1] / second[1] * second
    return [first[:3], second[:3], third[:3]], np.stack([first[3], second[3], third[3]])


def back_substituted(upper: list[np.ndarray], right: np.ndarray) -> np.ndarray:
    """(3, P) solutions of Ux = right."""
    first, second, third = upper
    x = np.empty_like(right)
    x[2] = right[2] / third[2]
    x[1] = (right[1] - second[2] * x[2]) / second[1]
    x[0] = (right[0] - first[1] * x[1] - first[2] * x[2]) / first[0]
    return x
