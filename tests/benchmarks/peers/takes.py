"""One take of the robot arm as a user of another library would write it down, in NumPy, all
particles at once: the law of a step under the Wishart model, and the likelihood of a measurement.
Joint limits and singular poses are left out, to the peers' advantage.
"""

import numpy as np
from scipy import linalg, stats

ROWS = 6  # m of the pose of a tip in space


def take_of(law, **plain) -> "Take":
    """The take of `scenario.Take.plain`, moved by ``law``."""
    return (PlanarTake if "links" in plain else SpatialTake)(law, **plain)


class Take:
    """A motion of M steps of n joints; subclasses ``move(q, command)`` the particles."""

    def __init__(
        self,
        steps,
        start_mean,
        start_covariance,
        seen,
        y,
        covariance,
    ) -> None:
        # (M, m), or (M, m + n) of more joints than task rows
        self.steps = np.array(steps)
        self.start_mean = np.array(start_mean)
        self.start_covariance = np.array(start_covariance)
        # by the step that a frame falls on
        self.y = dict(zip(seen, np.array(y), strict=True))
        self.precision = np.linalg.inv(covariance)
        self.rng = np.random.default_rng(1)

    def start(self, count: int) -> np.ndarray:
        """(P, n) particles before the first step; every call has the same random numbers."""
        self.rng = np.random.default_rng(1)
        np.random.seed(1)  # noqa: NPY002 - the libraries resample by it
        return self.rng.multivariate_normal(
            self.start_mean,
            self.start_covariance,
            count,
        )

    def step(self, k: int, q: np.ndarray) -> np.ndarray:
        """(P, n) particles after step k = 1 … M, from those before."""
        return self.move(q, self.steps[k - 1])

    def log_likelihood(self, k: int, q: np.ndarray) -> np.ndarray:
        """(P,) log density, up to a constant, of the frame that falls on step k."""
        error = self.y[k] - q
        return -0.5 * np.einsum("pi,pi->p", error @ self.precision, error)

    def inverse_action(self, a: np.ndarray) -> np.ndarray:
        """(m, P) B⁻¹a = r·R·[z, zT] of ``a`` (m, P): two χ² and m − 1 normals a particle, no matrix
        drawn.
        """
        m, count = a.shape
        d = self.d
        z = d / self.rng.chisquare(d - m + 1, count)
        t = self.rng.standard_normal((m - 1, count))
        t /= np.sqrt(self.rng.chisquare(d - m + 2, count))

        # R by the Householder reflection that takes the first axis to ±a/r
        r = np.sqrt((a * a).sum(axis=0))
        mirror = a.copy()
        mirror[0] += np.copysign(r, a[0])
        along = (mirror[1:] * t).sum(axis=0) / (r + np.abs(a[0]))
        action = a - along * mirror
        action[1:] += r * t
        return z * action


class PlanarTake(Take):
    """A motion of a planar arm of three joints: the exact law, or the paper's Algorithm 1."""

    def __init__(self, law, links, signs, sigma_b, **plain) -> None:
        super().__init__(**plain)
        laws = {"closed form": self.closed_form, "Algorithm 1": self.algorithm_1}
        self.move = laws[law]
        self.links, self.signs = np.array(links), np.array(signs)
        self.d = 4 / sigma_b**2  # (n + 1)/σ_B²

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(P, 3, 3) rows x, z, φ."""
        heading = np.cumsum(q * self.signs, axis=1)
        sine = np.sin(heading)
        cosine = np.cos(heading)
        along, across = self.links.T
        x = cosine * along + sine * across
        z = cosine * across - sine * along
        # each joint moves all links after it
        moved_x = np.cumsum(x[:, ::-1], axis=1)[:, ::-1]
        moved_z = np.cumsum(z[:, ::-1], axis=1)[:, ::-1]
        jacobian = np.empty((len(q), 3, 3))
        jacobian[:, 0] = self.signs * moved_z
        jacobian[:, 1] = -self.signs * moved_x
        jacobian[:, 2] = self.signs
        return jacobian

    def closed_form(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Draw B⁻¹a between the factors of J."""
        upper, a = eliminated(self.jacobian(q), v)
        x = self.inverse_action(a)
        for r in (2, 1, 0):  # Ux = B⁻¹a
            below = (upper[r, r + 1 :] * x[r + 1 :]).sum(axis=0)
            x[r] = (x[r] - below) / upper[r, r]
        return q + x.T

    def algorithm_1(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Draw B, solve J₁BJ₂q̇ = v: the paper's steps by the libraries' functions."""
        first, second = linalg.lu(self.jacobian(q), permute_l=True)
        law = {"df": self.d, "scale": np.eye(3) / self.d}
        b = stats.wishart.rvs(**law, size=len(q), random_state=self.rng)
        random = first @ b @ second
        return q + np.linalg.solve(random, v[:, None])[..., 0]


def eliminated(jacobian: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U (3, 3, P) and a = J₁⁻¹v (3, P) of the LU decomposition with partial pivoting of all J
    (P, 3, 3).
    """
    rows = np.empty((3, 4, len(jacobian)))
    rows[:, :3] = jacobian.transpose(1, 2, 0)
    rows[:, 3] = v[:, None]
    pivot = np.abs(rows[:, 0]).argmax(axis=0)
    later = np.where(pivot == 1, rows[1], rows[2])
    first = np.where(pivot == 0, rows[0], later)
    upper = np.where(pivot == 1, rows[0], rows[1])
    lower = np.where(pivot == 2, rows[0], rows[2])
    upper = upper - upper[0] / first[0] * first
    lower = lower - lower[0] / first[0] * first
    exchanged = np.abs(lower[1]) > np.abs(upper[1])
    second = np.where(exchanged, lower, upper)
    third = np.where(exchanged, upper, lower)
    third = third - third[1] / second[1] * second
    eliminated_rows = np.stack([first, second, third])
    return eliminated_rows[:, :3], eliminated_rows[:, 3]


class SpatialTake(Take):
    """A motion of an arm in space of n revolute joints, by QR of Jᵀ; its task is the tip's pose."""

    def __init__(self, law, placements, sigma_b, **plain) -> None:
        super().__init__(**plain)
        assert law == "closed form"
        placements = np.array(placements)  # (n + 1, 12)
        self.turns, self.ways = placements[:, :9].reshape(-1, 3, 3), placements[:, 9:]
        self.d = (ROWS + 1) / sigma_b**2

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(6, n, P) rows of velocity and angular velocity, the particles last."""
        joints = q.shape[1]
        count = len(q)
        sine = np.sin(q.T)
        cosine = np.cos(q.T)
        turned = np.repeat(np.eye(3)[:, :, None], count, axis=2)
        point = np.zeros((3, count))
        axes, points = np.empty((2, joints, 3, count))
        for j in range(joints):
            point = point + np.einsum("ikp,k->ip", turned, self.ways[j])
            turned = np.einsum("ikp,kj->ijp", turned, self.turns[j])
            axes[j], points[j] = turned[:, 2], point
            x = turned[:, 0] * cosine[j] + turned[:, 1] * sine[j]
            y = turned[:, 1] * cosine[j] - turned[:, 0] * sine[j]
            turned[:, 0], turned[:, 1] = x, y
        way = point + np.einsum("ikp,k->ip", turned, self.ways[joints]) - points
        jacobian = np.empty((ROWS, joints, count))
        for row, (y, z) in enumerate(((1, 2), (2, 0), (0, 1))):
            jacobian[row] = axes[:, y] * way[:, z] - axes[:, z] * way[:, y]
            jacobian[3 + row] = axes[:, row]
        return jacobian

    def move(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """q + w + Qᵀ(B⁻¹L⁻¹v − Qw), J = LQ by Gram–Schmidt, of the ``command`` v, or v and w."""
        rows = self.jacobian(q)  # becomes Q in its place
        a = np.empty((ROWS, len(q)))  # L⁻¹v
        for r, row in enumerate(rows):
            rest = np.full(len(q), command[r])
            for s in range(r):
                entry = np.einsum("jp,jp->p", row, rows[s])
                row -= entry * rows[s]
                rest -= entry * a[s]
            length = np.sqrt(np.einsum("jp,jp->p", row, row))
            row /= length
            a[r] = rest / length
        step = self.inverse_action(a)
        if len(command) == ROWS:
            return q + np.einsum("rjp,rp->pj", rows, step)
        w = command[ROWS:]
        across = step - np.einsum("rjp,j->rp", rows, w)
        return q + w + np.einsum("rjp,rp->pj", rows, across)
