"""The density of w = B⁻¹a for B ~ W_n(d, I/d), n = 3: in closed form, and blurred by normal noise by quadrature.

With r = ‖a‖, e = a/r the law is w = r·R·[z, z·T]ᵀ (see :mod:`pipeline.motion.wishart`), so with u₁ = eᵀw/r > 0 and u⊥ the rest of w/r

    p(w) = r⁻ⁿ · p_z(u₁) · p_T(‖u⊥‖/u₁) · u₁^{−(n−1)},

z inverse-gamma of shape (d−n+1)/2 and scale d/2, T of density ∝ (1 + ‖t‖²)^{−(d+1)/2}; there is none where u₁ ≤ 0.

Of x = w + ε, ε ~ N(0, C), only the given z and g of T = N(0, I)/√g, g ~ χ²(d−n+2), make a normal: x | z, g ~ N(za, C + (rz)²/g·(I − eeᵀ)).
Both are taken out by quadrature over s = ln z and h = ln g. Written in the axes of C given its part along e, the normal is a product of
scalars. The integrand is narrow where C is small and wide where it is large; so the rule follows it (Naylor and Smith, Applied
Statistics 31, 1982): centred on its mode, scaled by its Fisher information there, then by its own mean and covariance under that
first rule. In scaled coordinates sinh t it is a trapezoidal rule in t, which has no end of accuracy for exponential tails and normal ones.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

DIMENSION = 3
RANGE = 3.0  # of t: ± sinh 3 = ± 10 standard deviations
NODES = 17  # for each of s and h
ASCENTS = 60  # steps of Fisher scoring at most
HALVINGS = 8
SETTLED = 1e-3  # of a standard deviation: the mode need not be nearer
LEAST_SHARE = 1e-3  # of the first covariance in the second: all mass at one node is no reason for none
BLOCK = 256  # steps at a time, so that the grids stay in the cache


def action_log_density(w: np.ndarray, a: np.ndarray, d: float) -> np.ndarray:
    """(...,) log density of B⁻¹a at ``w`` (..., 3), for ``a`` (..., 3) not zero; −inf where wᵀa ≤ 0, which no B > 0 can give."""
    n = DIMENSION
    r = np.sqrt(np.vecdot(a, a))
    e, u = a / r[..., None], w / r[..., None]
    along = np.vecdot(e, u)
    inside = along > 0
    z = np.where(inside, along, 1.0)
    t = (u - along[..., None] * e) / z[..., None]
    shape = (d - n + 1) / 2
    of_z = shape * np.log(d / 2) - gammaln(shape) - (shape + 1) * np.log(z) - d / (2 * z)
    of_t = gammaln((d + 1) / 2) - gammaln((d - n + 2) / 2) - (n - 1) / 2 * np.log(np.pi) - (d + 1) / 2 * np.log1p(np.vecdot(t, t))
    return np.where(inside, of_z + of_t - n * np.log(r) - (n - 1) * np.log(z), -np.inf)


def frames(a: np.ndarray) -> np.ndarray:
    """(..., 3, 3) orthonormal matrices R of first column a/‖a‖, for ``a`` (..., 3) not zero: Householder's reflection, its sign turned."""
    r = np.sqrt(np.vecdot(a, a))
    sign = np.where(a[..., 0] < 0, -1.0, 1.0)
    mirror = a.copy()
    mirror[..., 0] += sign * r
    reach = r * (r + np.abs(a[..., 0]))
    reflection = np.eye(a.shape[-1]) - mirror[..., :, None] * mirror[..., None, :] / reach[..., None, None]
    return -sign[..., None, None] * reflection


class _Integrand:
    """ln of p(z)p(g)p(x | z, g)·zg over (s, h) for N steps, and its gradient and Fisher information."""

    def __init__(self, x: np.ndarray, a: np.ndarray, noise: np.ndarray, d: float) -> None:
        r = np.sqrt(np.vecdot(a, a))
        turn = frames(a)
        x = np.matvec(np.swapaxes(turn, -1, -2), x) / r[:, None]
        c = np.swapaxes(turn, -1, -2) @ noise @ turn / (r**2)[:, None, None]
        slope = c[:, 1:, 0] / c[:, :1, 0]
        across = c[:, 1:, 1:] - slope[:, :, None] * c[:, None, 0, 1:]
        variances, axes = np.linalg.eigh((across + np.swapaxes(across, -1, -2)) / 2)
        self.d, self.log_r = d, np.log(r)
        self.along, self.variance = x[:, :1], c[:, :1, 0]  # (N, 1) as all that follow
        self.across = [np.vecdot(axes[..., i], x[:, 1:])[:, None] for i in (0, 1)]
        self.slope = [np.vecdot(axes[..., i], slope)[:, None] for i in (0, 1)]
        # rounding can take the least of them to zero or below
        floor = np.finfo(float).eps * c.max(axis=(-1, -2))
        self.variances = [np.maximum(variances[:, i], floor)[:, None] for i in (0, 1)]

    def _of_z(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        """z, the residual along e, and those across it given that, for ``s`` (N, G)."""
        z = np.exp(s)
        rest = self.along - z
        return z, rest, [b - k * rest for b, k in zip(self.across, self.slope, strict=True)]

    def __call__(self, s: np.ndarray, h: np.ndarray) -> np.ndarray:
        """(N, G, K) for ``s`` (N, G) and ``h`` (N, G, K), of the density of x/r."""
        shape, m = (self.d - DIMENSION + 1) / 2, self.d - DIMENSION + 2
        z, rest, across = self._of_z(s)
        of_s = shape * (np.log(self.d / 2) - s) - self.d / 2 / z - gammaln(shape) - m / 2 * np.log(2) - gammaln(m / 2)
        of_s -= 0.5 * (np.log((2 * np.pi) ** DIMENSION * self.variance) + rest**2 / self.variance)
        g = np.exp(h)
        spread = (z**2)[..., None] / g
        first, second = (v[..., None] + spread for v in self.variances)
        quadratic = (across[0] ** 2)[..., None] / first + (across[1] ** 2)[..., None] / second
        return of_s[..., None] + 0.5 * (m * h - g - np.log(first * second) - quadratic)

    def slopes(self, s: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (N, 2) and Fisher information (N, 2, 2) at ``s`` and ``h`` (N, 1)."""
        shape, m = (self.d - DIMENSION + 1) / 2, self.d - DIMENSION + 2
        z, rest, across = self._of_z(s)
        g = np.exp(h)
        spread = z**2 / g
        of_s = -shape + self.d / 2 / z + rest * z / self.variance
        of_h = (m - g) / 2
        ss, sh, hh = self.d / 2 / z + z**2 / self.variance, 0.0, g / 2
        for c, k, v in zip(across, self.slope, self.variances, strict=True):
            total = v + spread
            share, excess = spread / total, c**2 / total - 1
            of_s = of_s + share * excess - c * k * z / total
            of_h = of_h - 0.5 * share * excess
            ss, sh, hh = ss + 2 * share**2 + (k * z) ** 2 / total, sh - share**2, hh + share**2 / 2
        information = np.empty((len(s), 2, 2))
        information[:, 0, 0], information[:, 1, 1] = ss[:, 0], hh[:, 0]
        information[:, 0, 1] = information[:, 1, 0] = sh[:, 0]
        return np.concatenate([of_s, of_h], axis=1), information

    def of(self, steps: np.ndarray) -> _Integrand:
        """The integrand of some of the steps, by their numbers."""
        chosen = object.__new__(_Integrand)
        chosen.d, chosen.log_r = self.d, self.log_r[steps]
        chosen.along, chosen.variance = self.along[steps], self.variance[steps]
        chosen.across, chosen.slope, chosen.variances = ([x[steps] for x in xs] for xs in (self.across, self.slope, self.variances))
        return chosen

    def mode(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 2) a mode in (s, h) by Fisher scoring, steps halved where they would descend, and the covariance (N, 2, 2) it suggests."""
        # from where the noise-free step would be, or from the law's own middle where that is none
        place = np.empty((len(self.along), 2))
        place[:, 0] = np.log(np.maximum(self.along[:, 0], 0.1))
        place[:, 1] = np.log(self.d)
        climbing, on = np.arange(len(place)), self
        covariance = np.empty((len(place), 2, 2))
        for _ in range(ASCENTS):
            at = place[climbing]
            gradient, information = on.slopes(at[:, :1], at[:, 1:])
            covariance[climbing] = np.linalg.inv(information)
            step = np.matvec(covariance[climbing], gradient)
            far = np.sqrt(np.maximum(np.vecdot(step, gradient), 0.0)) >= SETTLED
            if not np.any(far):
                break
            climbing, on, at, step = climbing[far], on.of(far), at[far], step[far]
            step /= np.maximum(1.0, np.abs(step).max(axis=1))[:, None]  # no further than a factor e at once
            place[climbing] = at + on.climb(at, step)
        return place, covariance

    def climb(self, place: np.ndarray, step: np.ndarray) -> np.ndarray:
        """(N, 2) ``step`` from ``place`` (N, 2), halved up to HALVINGS times where it would descend, and none where it still would."""
        value = self(place[:, :1], place[:, 1:, None])[:, 0, 0]
        for _ in range(HALVINGS):
            tried = self((place + step)[:, :1], (place + step)[:, 1:, None])[:, 0, 0]
            descends = tried < value
            if not np.any(descends):
                return step
            step = np.where(descends[:, None], step / 2, step)
        return np.where(descends[:, None], 0.0, step)


def _rule(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and log weights (``nodes``,) of the trapezoidal rule in t for an integral over ξ = sinh t."""
    t, step = np.linspace(-RANGE, RANGE, nodes, retstep=True)
    return np.sinh(t), np.log(step * np.cosh(t))


def _integral(integrand: _Integrand, nodes: int) -> np.ndarray:
    xi, weight = _rule(nodes)
    weights = weight[:, None] + weight
    centre, covariance = integrand.mode()
    for last in (False, True):
        root = np.linalg.cholesky(covariance)
        s = centre[:, :1] + root[:, 0, :1] * xi
        h = centre[:, 1, None, None] + root[:, 1, 0, None, None] * xi[:, None] + root[:, 1, 1, None, None] * xi
        values = integrand(s, h) + weights
        top = values.max(axis=(1, 2), keepdims=True)
        mass = np.exp(values - top)
        total = mass.sum(axis=(1, 2))
        if last:
            break
        mass /= total[:, None, None]
        of_s = mass.sum(axis=2)
        mean_s, mean_h = (of_s * s).sum(axis=1), (mass * h).sum(axis=(1, 2))
        ds, dh = s - mean_s[:, None], h - mean_h[:, None, None]
        centre = np.stack([mean_s, mean_h], axis=1)
        covariance *= LEAST_SHARE
        covariance[:, 0, 0] += (of_s * ds**2).sum(axis=1)
        covariance[:, 1, 1] += (mass * dh**2).sum(axis=(1, 2))
        covariance[:, [0, 1], [1, 0]] += (mass * ds[..., None] * dh).sum(axis=(1, 2))[:, None]
    return top[:, 0, 0] + np.log(total) + np.log(root[:, 0, 0] * root[:, 1, 1]) - DIMENSION * integrand.log_r


def blurred_log_density(x: np.ndarray, a: np.ndarray, noise: np.ndarray, d: float, nodes: int = NODES) -> np.ndarray:
    """(N,) log density of B⁻¹a + ε at ``x`` (N, 3), for ``a`` (N, 3) not zero and ε ~ N(0, C), C = ``noise`` (N, 3, 3) positive definite.

    ``nodes`` for each of the two integrals; the defaults leave a relative error of the density below 1e-4 for the arm's steps.
    """
    blocks = [slice(start, start + BLOCK) for start in range(0, len(x), BLOCK)]
    return np.concatenate([_integral(_Integrand(x[i], a[i], noise[i], d), nodes) for i in blocks]) if blocks else np.zeros(0)
