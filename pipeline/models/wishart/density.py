"""The law of w = B⁻¹a for B ~ W_m(d, I/d): draws, its density in closed form, and the density of
J₂⁺w with normal noise by quadrature.

With r = ‖a‖, e = a/r the law is w = r·R·[z, z·T]ᵀ (:mod:`.law`), so with u₁ = eᵀw/r > 0 and u⊥ the
rest of w/r

    p(w) = r⁻ᵐ · p_z(u₁) · p_T(‖u⊥‖/u₁) · u₁^{−(m−1)},

z inverse-gamma of shape (d−m+1)/2 and scale d/2, T of density ∝ (1 + ‖t‖²)^{−(d+1)/2}.

T = N(0, I)/√g, g ~ χ²(d−m+2), so given z and g a step with measurement noise Σ_m is normal of mean
z·b, b = J₂⁺a, and covariance Σ_m + (z²/g)MMᵀ, M = r·J₂⁺(I − eeᵀ) of rank m − 1. In units in which
Σ_m = I, with u_i and √λ_i the left singular vectors and values of M, c_i = u_iᵀy and k_i = u_iᵀb,

    −2 ln N = ‖y⊥ − z·b⊥‖² + Σ_i [(c_i − z·k_i)²/(1 + λ_i z²/g) + ln(1 + λ_i z²/g)] + constant,

to be integrated over z and g (:mod:`.quadrature`).
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
    t_term = lgamma((d + 1) / 2) - lgamma((d - m + 2) / 2) - (m - 1) / 2 * np.log(np.pi)
    t_term = t_term - (d + 1) / 2 * np.log1p(np.vecdot(t, t))
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
    """(..., m, m) orthonormal matrices of first column a/‖a‖, for ``a`` (..., m) not zero:
    Householder's reflection with its sign changed.
    """
    r = np.sqrt(np.vecdot(a, a))
    sign = np.where(a[..., 0] < 0, -1.0, 1.0)
    mirror = a.copy()
    mirror[..., 0] += sign * r
    reach = (r * (r + np.abs(a[..., 0])))[..., None, None]
    reflection = np.eye(a.shape[-1]) - mirror[..., :, None] * mirror[..., None, :] / reach
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

    ``step`` is q_{k+1} − q_k without its part in the null space of J, ``measurement`` (n, n) the
    covariance of ε in rad², positive definite, ``d`` the degrees of freedom of B. With the default
    ``nodes`` for each integral the relative error of the density is below 1e-4.
    """
    from pipeline.models.wishart.quadrature import log_integrals  # here, as it loads the compiler

    lower = np.linalg.cholesky(measurement)
    white = np.linalg.inv(lower)
    numbers = mixture(step @ white.T, a, white @ back)
    constant = np.log(np.diag(lower)).sum() + 0.5 * len(lower) * np.log(2 * np.pi)
    return log_integrals(numbers, a.shape[-1], d, nodes) - constant


def mixture(y: np.ndarray, a: np.ndarray, back: np.ndarray) -> np.ndarray:
    """(N, 3 + 3(m − 1)) z₀ = b⊥ᵀy⊥/‖b⊥‖², ‖b⊥‖² and ‖y⊥ − z₀b⊥‖² of N steps, then c_i, k_i and
    λ_i of each direction.

    ``y`` L⁻¹(q_{k+1} − q_k) (N, n), ``a`` J₁⁻¹v (N, m) not zero, ``back`` L⁻¹J₂⁺ (N, n, m), Σ_m =
    LLᵀ.
    """
    n, m = back.shape[1:]
    r = np.sqrt(np.vecdot(a, a))[:, None, None]
    left, singular, _ = np.linalg.svd(r * (back @ frames(a)[..., 1:]), full_matrices=False)
    b = np.matvec(back, a)
    c, k = np.vecmat(y, left), np.vecmat(b, left)
    y, b = y - np.matvec(left, c), b - np.matvec(left, k)
    precision = np.vecdot(b, b)
    z0 = np.vecdot(y, b) / precision
    rest = y - z0[:, None] * b
    rest = np.vecdot(rest, rest) if n > m else np.zeros(len(a))
    directions = np.stack([c, k, singular**2], axis=-1).reshape(len(a), 3 * (m - 1))
    return np.concatenate([np.stack([z0, precision, rest], axis=1), directions], axis=1)
