"""Density of J₂⁺B⁻¹a plus normal noise by compiled quadrature.

T = N(0, I)/√g, g ~ χ²(d−m+2) (:mod:`.law`). Given z and g a step with measurement noise Σ_m is
normal with mean z·b, b = J₂⁺a, and covariance Σ_m + (z²/g)MMᵀ, M = r·J₂⁺(I − eeᵀ) of rank m − 1. In
units in which Σ_m = I, with u_i and √λ_i the left singular vectors and values of M, c_i = u_iᵀy and
k_i = u_iᵀb,

    −2 ln N = ‖y⊥ − z·b⊥‖² + Σ_i [(c_i − z·k_i)²/(1 + λ_i z²/g) + ln(1 + λ_i z²/g)] + constant.

The density is integrated over s = ln z and h = ln g by an adaptive rule (Naylor and Smith, Applied
Statistics 31, 1982). The first rule is centred on the mode of the integrand and scaled by its
Fisher information; the second uses the mean and covariance found by the first. In coordinates sinh
t the trapezoidal rule converges fast for exponential and normal tails.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.core.compiled import compiled, inner
from pipeline.models.wishart.decomposition import frames

NODES = 17  # of the rule in s and in h
# terms of a step, then terms per direction
ALONG = 3
DIRECTION = 3
RANGE = 3.0  # of t: ± sinh 3 = ± 10 standard deviations
# most Fisher scoring steps, most step halvings
ASCENTS = 60
HALVINGS = 8
SETTLED = 1e-3  # tolerance of the mode in standard deviations
# of the first covariance added to the second, in case all mass is at one node
LEAST_SHARE = 1e-3
# ln of a node's term relative to the greatest term; below it the mass is zero
FADED = -45.0


def blurred_log_density(
    step: ndarray,
    a: ndarray,
    back: ndarray,
    measurement: ndarray,
    d: float,
    nodes: int = NODES,
) -> ndarray:
    """(N,) log density of J₂⁺B⁻¹a + ε at ``step`` (N, n) in rad, q_{k+1} − q_k without its part in
    the null space of J. ``a`` (N, m) is not zero, ``back`` is J₂⁺ (N, n, m), ``measurement`` (n, n)
    the positive definite covariance of ε in rad², ``d`` the degrees of freedom of B. The relative
    error of the density is below 1e-4 with the default ``nodes`` for each integral.
    """
    return mixture_log_density(mixture(step, a, back, measurement), d, nodes)


class Mixture(NamedTuple):
    """Contribution of N steps and of the measurement noise to the density, equal for every d."""

    terms: ndarray  # (N, 3 + 3(m − 1)) of :func:`_terms`
    m: int
    normaliser: float  # ln of the constant of N(0, Σ_m)


def mixture(step: ndarray, a: ndarray, back: ndarray, measurement: ndarray) -> Mixture:
    """Return the mixture of the arguments of :func:`blurred_log_density`."""
    lower = np.linalg.cholesky(measurement)
    white = np.linalg.inv(lower)
    terms = _terms(step @ white.T, a, white @ back)
    log_determinant = np.log(np.diag(lower)).sum()
    normaliser = log_determinant + 0.5 * len(lower) * np.log(2 * np.pi)
    return Mixture(terms, a.shape[-1], normaliser)


def mixture_log_density(mixture: Mixture, d: float, nodes: int = NODES) -> ndarray:
    """(N,) log density as :func:`blurred_log_density`."""
    from scipy.special import gammaln

    shape = (d - mixture.m + 1) / 2
    freedom = float(d - mixture.m + 2)
    t, spacing = np.linspace(-RANGE, RANGE, nodes, retstep=True)
    rule = np.stack([np.sinh(t), spacing * np.cosh(t)])
    constant = shape * np.log(d / 2) - gammaln(shape)
    constant -= freedom / 2 * np.log(2) + gammaln(freedom / 2)
    integrals = _integrate(mixture.terms, float(d), (float(shape), freedom), rule)
    return integrals + constant - mixture.normaliser


def _terms(y: ndarray, a: ndarray, back: ndarray) -> ndarray:
    """(N, 3 + 3(m − 1)) z₀ = b⊥ᵀy⊥/‖b⊥‖², ‖b⊥‖² and ‖y⊥ − z₀b⊥‖², then c_i, k_i and λ_i of each
    direction, in units in which Σ_m = I.
    """
    n, m = back.shape[1:]
    r = np.sqrt(np.vecdot(a, a))[:, None, None]
    across = r * (back @ frames(a)[..., 1:])  # M
    left, singular, _ = np.linalg.svd(across, full_matrices=False)
    b = np.matvec(back, a)
    c = np.vecmat(y, left)
    k = np.vecmat(b, left)
    y = y - np.matvec(left, c)
    b = b - np.matvec(left, k)

    precision = np.vecdot(b, b)
    z0 = np.vecdot(y, b) / precision
    squares = np.zeros(len(a))
    if n > m:
        rest = y - z0[:, None] * b
        squares = np.vecdot(rest, rest)
    along = np.stack([z0, precision, squares], axis=1)
    directions = np.stack([c, k, singular**2], axis=-1)
    directions = directions.reshape(len(a), DIRECTION * (m - 1))
    return np.concatenate([along, directions], axis=1)


@inner
def _log_integrand(case: ndarray, d: float, law: tuple, s: float, h: float) -> float:
    """ln of the integrand up to a constant."""
    shape, freedom = law
    z = np.exp(s)
    spread = z * z * np.exp(-h)
    rest = z - case[0]
    value = case[1] * rest * rest + np.exp(h) - freedom * h
    for i in range(ALONG, len(case), DIRECTION):
        residual = case[i] - z * case[i + 1]
        total = 1 + spread * case[i + 2]
        value += residual * residual / total + np.log(total)
    return -shape * s - d / 2 / z - 0.5 * value


@inner
def _mode(
    case: ndarray,
    d: float,
    law: tuple,
) -> tuple[float, float, float, float, float]:
    """Mode (s, h) by Fisher scoring with step halving, and the covariance (ss, sh, hh) there."""
    # start: z of the step without measurement noise, at least 0.1
    shape, freedom = law
    s = np.log(max(case[0], 0.1))
    h = np.log(d)
    ss = sh = hh = 0.0
    for _ in range(ASCENTS):
        z = np.exp(s)
        g = np.exp(h)
        spread = z * z / g
        squared = case[1] * z * z
        of_s = -shape + d / 2 / z + case[1] * (case[0] - z) * z
        of_h = (freedom - g) / 2
        ss = d / 2 / z + squared
        sh = 0.0
        hh = g / 2
        for i in range(ALONG, len(case), DIRECTION):
            slope = z * case[i + 1]
            variance = spread * case[i + 2]
            residual = case[i] - slope
            total = 1 + variance
            share = variance / total
            excess = residual * residual / total - 1
            of_s += share * excess + residual * slope / total
            of_h -= 0.5 * share * excess
            ss += 2 * share * share + slope * slope / total
            sh -= share * share
            hh += share * share / 2
        determinant = ss * hh - sh * sh
        ss, sh, hh = hh / determinant, -sh / determinant, ss / determinant
        step_s = ss * of_s + sh * of_h
        step_h = sh * of_s + hh * of_h
        if step_s * of_s + step_h * of_h < SETTLED**2:
            break
        longest = max(abs(step_s), abs(step_h), 1.0)  # at most a factor e per step
        step_s = step_s / longest
        step_h = step_h / longest
        value = _log_integrand(case, d, law, s, h)
        for _ in range(HALVINGS):
            if _log_integrand(case, d, law, s + step_s, h + step_h) >= value:
                s = s + step_s
                h = h + step_h
                break
            step_s = step_s / 2
            step_h = step_h / 2
    return s, h, ss, sh, hh


@compiled
def _integrate(
    terms: ndarray,
    d: float,
    law: tuple[float, float],
    rule: ndarray,
) -> ndarray:
    """(N,) ln of the integral up to a constant, from the ``terms`` of :func:`_terms`, with the
    nodes and weights ``rule`` (2, K) of the scaled s and h.
    """
    xi = rule[0]
    nodes = rule.shape[1]
    result = np.empty(len(terms))
    shape_of_grid = (nodes, nodes)
    exponent = np.empty(shape_of_grid)
    mass = np.empty(shape_of_grid)
    rows = np.empty((4, nodes))
    # the exponent leaves out the determinant of the normal law: a square root per direction
    faded = FADED * max(1, (terms.shape[1] - ALONG) // DIRECTION - 1)
    for n in range(len(terms)):
        case = terms[n]
        centre_s, centre_h, ss, sh, hh = _mode(case, d, law)
        for last in (False, True):
            root_s = np.sqrt(ss)
            slant = sh / root_s
            root_h = np.sqrt(hh - slant * slant)
            place = (centre_s, centre_h, root_s, slant, root_h)
            top = _fill_nodes(case, d, law, place, rule, rows, exponent, mass)
            sums = _node_sums(exponent, mass, top, faded, place, xi)
            total, mean_s, mean_h, new_ss, new_sh, new_hh = sums
            if last:
                result[n] = top + np.log(total * root_s * root_h) - 0.5 * case[2]
                break
            mean_s = mean_s / total
            mean_h = mean_h / total
            centre_s = centre_s + mean_s
            centre_h = centre_h + mean_h
            ss = LEAST_SHARE * ss + max(new_ss / total - mean_s * mean_s, 0.0)
            hh = LEAST_SHARE * hh + max(new_hh / total - mean_h * mean_h, 0.0)
            sh = LEAST_SHARE * sh + new_sh / total - mean_s * mean_h
    return result


@inner
def _fill_nodes(case, d, law, place, rule, rows, exponent, mass) -> float:
    """Fill ``exponent`` and ``mass`` (K, K) of the terms at the nodes, and return the greatest
    exponent. ``place`` has the centre (s, h) and the Cholesky factor (ss, hs, hh) of the scale;
    ``rows`` (4, K) is scratch.
    """
    centre_s, centre_h, root_s, slant, root_h = place
    shape, freedom = law
    xi = rule[0]
    weight = rule[1]
    nodes = rule.shape[1]
    factor = rows[0]
    spread = rows[1]
    squares = rows[2]
    product = rows[3]
    # one exponential per node: e^h is a product of two factors
    for j in range(nodes):
        factor[j] = np.exp(root_h * xi[j])
    top = -np.inf
    for i in range(nodes):
        s = centre_s + root_s * xi[i]
        of_h = centre_h + slant * xi[i]
        z = np.exp(s)
        g = np.exp(of_h)
        rest = z - case[0]
        squared = z * z / g
        of_s = -shape * s - d / 2 / z - 0.5 * case[1] * rest * rest
        for j in range(nodes):
            spread[j] = squared / factor[j]
            squares[j] = 0.0
            product[j] = 1.0
        for k in range(ALONG, len(case), DIRECTION):
            residual = (case[k] - z * case[k + 1]) ** 2
            size = case[k + 2]
            for j in range(nodes):
                scale = 1 + spread[j] * size
                squares[j] += residual / scale
                product[j] *= scale
        for j in range(nodes):
            h = of_h + root_h * xi[j]
            value = freedom * h - g * factor[j] - squares[j]
            exponent[i, j] = of_s + 0.5 * value
            mass[i, j] = weight[i] * weight[j] / np.sqrt(product[j])
            top = max(top, exponent[i, j])
    return top


@inner
def _node_sums(exponent, mass, top, faded, place, xi):
    """Sum of the terms, and sums of the terms times s, h, s², sh and h² from the centre."""
    _, _, root_s, slant, root_h = place
    total = of_s = of_h = ss = sh = hh = 0.0
    for i in range(len(xi)):
        ds = root_s * xi[i]
        for j in range(len(xi)):
            lower = exponent[i, j] - top
            dh = slant * xi[i] + root_h * xi[j]
            share = mass[i, j] * np.exp(lower) if lower > faded else 0.0
            total += share
            of_s += share * ds
            of_h += share * dh
            ss += share * ds * ds
            sh += share * ds * dh
            hh += share * dh * dh
    return total, of_s, of_h, ss, sh, hh
