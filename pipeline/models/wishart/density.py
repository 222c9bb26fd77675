"""The density of w = B⁻¹a for B ~ W_n(d, I/d): in closed form, and for n = 3 blurred by normal
noise by quadrature.

With r = ‖a‖, e = a/r the law is w = r·R·[z, z·T]ᵀ (see :mod:`.law`), so with u₁
= eᵀw/r > 0 and u⊥ the rest of w/r

    p(w) = r⁻ⁿ · p_z(u₁) · p_T(‖u⊥‖/u₁) · u₁^{−(n−1)},

z inverse-gamma of shape (d−n+1)/2 and scale d/2, T of density ∝ (1 + ‖t‖²)^{−(d+1)/2}; there is
none where u₁ ≤ 0.

Of x = w + ε, ε ~ N(0, C), only the given z and g of T = N(0, I)/√g, g ~ χ²(d−n+2), make a normal: x
| z, g ~ N(za, C + (rz)²/g·(I − eeᵀ)). Both are taken out by quadrature
(:mod:`.quadrature`). Written in the axes of C given its part along e, the
normal is a product of scalars.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

NODES = 17  # of the quadrature for each of z and g


def action_log_density(w: np.ndarray, a: np.ndarray, d: float) -> np.ndarray:
    """(...,) log density of B⁻¹a at ``w`` (..., n), for ``a`` (..., n) not zero; −inf where wᵀa ≤
    0, which no B > 0 can give.
    """
    n = a.shape[-1]
    r = np.sqrt(np.vecdot(a, a))
    e, u = a / r[..., None], w / r[..., None]
    along = np.vecdot(e, u)
    inside = along > 0
    z = np.where(inside, along, 1.0)
    t = (u - along[..., None] * e) / z[..., None]
    shape = (d - n + 1) / 2
    z_term = shape * np.log(d / 2) - gammaln(shape) - (shape + 1) * np.log(z) - d / (2 * z)
    t_term = (
        gammaln((d + 1) / 2)
        - gammaln((d - n + 2) / 2)
        - (n - 1) / 2 * np.log(np.pi)
        - (d + 1) / 2 * np.log1p(np.vecdot(t, t))
    )
    return np.where(inside, z_term + t_term - n * np.log(r) - (n - 1) * np.log(z), -np.inf)


def frames(a: np.ndarray) -> np.ndarray:
    """(..., n, n) orthonormal matrices R of first column a/‖a‖, for ``a`` (..., n) not zero:
    Householder's reflection, its sign turned.
    """
    r = np.sqrt(np.vecdot(a, a))
    sign = np.where(a[..., 0] < 0, -1.0, 1.0)
    mirror = a.copy()
    mirror[..., 0] += sign * r
    reach = r * (r + np.abs(a[..., 0]))
    reflection = (
        np.eye(a.shape[-1]) - mirror[..., :, None] * mirror[..., None, :] / reach[..., None, None]
    )
    return -sign[..., None, None] * reflection


def blurred_log_density(
    x: np.ndarray, a: np.ndarray, noise: np.ndarray, d: float, nodes: int = NODES
) -> np.ndarray:
    """(N,) log density of B⁻¹a + ε at ``x`` (N, 3), for ``a`` (N, 3) not zero and ε ~ N(0, C), C =
    ``noise`` (N, 3, 3) positive definite.

    ``nodes`` for each of the two integrals; the defaults leave a relative error of the density
    below 1e-4 for the arm's steps.
    """
    from pipeline.models.wishart.quadrature import log_integrals  # here, as it loads the compiler

    r = np.sqrt(np.vecdot(a, a))
    turn = frames(a)
    x = np.matvec(np.swapaxes(turn, -1, -2), x) / r[:, None]
    c = np.swapaxes(turn, -1, -2) @ noise @ turn / (r**2)[:, None, None]
    variance = c[:, 0, 0]
    slope = c[:, 1:, 0] / variance[:, None]
    across = c[:, 1:, 1:] - slope[:, :, None] * c[:, None, 0, 1:]
    variances, axes = np.linalg.eigh((across + np.swapaxes(across, -1, -2)) / 2)
    # rounding can take the least of them to zero or below
    variances = np.maximum(variances, np.finfo(float).eps * c.max(axis=(-1, -2))[:, None])
    turned_back = np.swapaxes(axes, -1, -2)
    numbers = np.column_stack(
        [
            x[:, 0],
            variance,
            np.matvec(turned_back, x[:, 1:]),
            np.matvec(turned_back, slope),
            variances,
        ]
    )
    return (
        log_integrals(numbers, d, nodes)
        - a.shape[-1] * (np.log(r) + 0.5 * np.log(2 * np.pi))
        - 0.5 * np.log(variance)
    )
