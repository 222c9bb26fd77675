"""The law of a step of the Wishart model: draws and density of w = B⁻¹a for B ~ W_m(d, I/d) in
closed form, and the density of J₂⁺w with normal noise by quadrature.

With r = ‖a‖, e = a/r the law is w = r·R·[z, z·T]ᵀ (see :mod:`.law`), so with u₁
= eᵀw/r > 0 and u⊥ the rest of w/r

    p(w) = r⁻ᵐ · p_z(u₁) · p_T(‖u⊥‖/u₁) · u₁^{−(m−1)},

z inverse-gamma of shape (d−m+1)/2 and scale d/2, T of density ∝ (1 + ‖t‖²)^{−(d+1)/2}; there is
none where u₁ ≤ 0.

With measurement noise a step is a mixture of normals over z and g of T = N(0, I)/√g, g ~
χ²(d−m+2): both are taken out by quadrature (:mod:`.mixture`, :mod:`.quadrature`), whatever m.
"""

from __future__ import annotations

from math import lgamma

import numpy as np

NODES = 17  # of the quadrature for each of z and g


def action_log_density(w: np.ndarray, a: np.ndarray, d: float) -> np.ndarray:
    """(...,) log density of B⁻¹a at ``w`` (..., m), for ``a`` (..., m) not zero; −inf where wᵀa ≤
    0, which no B > 0 can give.
    """
    m = a.shape[-1]
    r = np.sqrt(np.vecdot(a, a))
    e, u = a / r[..., None], w / r[..., None]
    along = np.vecdot(e, u)
    inside = along > 0
    z = np.where(inside, along, 1.0)
    t = (u - along[..., None] * e) / z[..., None]
    shape = (d - m + 1) / 2
    z_term = shape * np.log(d / 2) - lgamma(shape) - (shape + 1) * np.log(z) - d / (2 * z)
    t_term = (
        lgamma((d + 1) / 2)
        - lgamma((d - m + 2) / 2)
        - (m - 1) / 2 * np.log(np.pi)
        - (d + 1) / 2 * np.log1p(np.vecdot(t, t))
    )
    return np.where(inside, z_term + t_term - m * np.log(r) - (m - 1) * np.log(z), -np.inf)


def draw_action(a: np.ndarray, d: float, rng: np.random.Generator) -> np.ndarray:
    """(..., m) a draw of B⁻¹a for each ``a`` (..., m); zero where a is."""
    batch, m = a.shape[:-1], a.shape[-1]
    z = d / rng.chisquare(d - m + 1, batch)
    t = rng.standard_normal((*batch, m - 1)) / np.sqrt(rng.chisquare(d - m + 2, (*batch, 1)))
    r = np.sqrt(np.vecdot(a, a))
    turned = frames(np.where(r[..., None] > 0, a, np.eye(m)[0]))
    return (r * z)[..., None] * (turned[..., 0] + np.matvec(turned[..., 1:], t))


def frames(a: np.ndarray) -> np.ndarray:
    """(..., m, m) orthonormal matrices R of first column a/‖a‖, for ``a`` (..., m) not zero:
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
    step: np.ndarray,
    a: np.ndarray,
    back: np.ndarray,
    measurement: np.ndarray,
    d: float,
    nodes: int = NODES,
) -> np.ndarray:
    """(N,) log density of J₂⁺B⁻¹a + ε at ``step`` (N, n) in rad, for ``a`` (N, m) not zero and
    ``back`` J₂⁺ (N, n, m).

    Args:
        step: q_{k+1} − q_k without its part in the null space of J.
        a: J₁⁻¹v.
        back: J₂⁺, of full column rank.
        measurement: (n, n) covariance of ε in rad², positive definite.
        d: degrees of freedom of B.
        nodes: for each of the two integrals; the default leaves a relative error of the density
            below 1e-4 for the arm's steps.
    """
    # here, as they load the compiler
    from pipeline.models.wishart.mixture import mixture
    from pipeline.models.wishart.quadrature import log_integrals

    lower = np.linalg.cholesky(measurement)
    white = np.linalg.inv(lower)
    numbers = mixture(step @ white.T, a, white @ back)
    constant = np.log(np.diag(lower)).sum() + 0.5 * len(lower) * np.log(2 * np.pi)
    return log_integrals(numbers, a.shape[-1], d, nodes) - constant
