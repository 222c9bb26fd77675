"""The integral over z and g that a step of the Wishart model with measurement noise has for a
density (:mod:`.density`).

Over s = ln z and h = ln g. The integrand is narrow where the noise is small and wide where it is
large; so the rule follows it (Naylor and Smith, Applied Statistics 31, 1982): centred on its mode,
scaled by its Fisher information there, then by its own mean and covariance under that first rule.
In scaled coordinates sinh t it is a trapezoidal rule in t, which has no end of accuracy for
exponential tails and normal ones.

Compiled, one step after the other, so that its grid stays in the cache.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from pipeline.core.compiled import compiled, inner

RANGE = 3.0  # of t: ± sinh 3 = ± 10 standard deviations
ASCENTS = 60  # steps of Fisher scoring at most
HALVINGS = 8
SETTLED = 1e-3  # of a standard deviation: the mode need not be nearer
# of the first covariance in the second: all mass at one node is no reason for none
LEAST_SHARE = 1e-3
FADED = -45.0  # logarithm of the share of the greatest term below which a node has no mass
DIMENSION = 3


def log_integrals(parameters: np.ndarray, d: float, nodes: int) -> np.ndarray:
    """(N,) ln ∫∫ p(z)p(g)·N(x; z, g)·zg ds dh of N steps, where all lengths are in units of ‖a‖ and
    (2π)^{3/2}·√c₁₁ is left out of N.

    ``parameters`` (N, 8): x along e; its variance c₁₁; x across e in the axes of C given its part
    along e (2); how these rise with the part along e (2); their variances (2). ``nodes`` for each
    of s and h.
    """
    shape, m = (d - DIMENSION + 1) / 2, d - DIMENSION + 2
    t, spacing = np.linspace(-RANGE, RANGE, nodes, retstep=True)
    constant = shape * np.log(d / 2) - gammaln(shape) - m / 2 * np.log(2) - gammaln(m / 2)
    result, room = np.empty(len(parameters)), np.empty((3, nodes, nodes))
    _integrate(
        np.ascontiguousarray(parameters),
        float(d),
        np.sinh(t),
        spacing * np.cosh(t),
        result,
        *room,
        np.empty(nodes),
    )
    return result + constant


@inner
def _of_z(parameters: np.ndarray, z: float) -> tuple[float, float, float]:
    """The residual of x along e at ``z``, and those across it given that."""
    rest = parameters[0] - z
    return rest, parameters[2] - parameters[4] * rest, parameters[3] - parameters[5] * rest


@inner
def _log_integrand(parameters: np.ndarray, d: float, s: float, h: float) -> float:
    """ln of the integrand but for what depends neither on s nor on h."""
    z, g = np.exp(s), np.exp(h)
    rest, across1, across2 = _of_z(parameters, z)
    spread = z * z / g
    first, second = parameters[6] + spread, parameters[7] + spread
    of_s = -(d - DIMENSION + 1) / 2 * s - d / 2 / z - 0.5 * rest * rest / parameters[1]
    return of_s + 0.5 * (
        (d - DIMENSION + 2) * h
        - g
        - np.log(first * second)
        - across1 * across1 / first
        - across2 * across2 / second
    )


@inner
def _slopes(
    parameters: np.ndarray, d: float, s: float, h: float
) -> tuple[float, float, float, float, float]:
    """Gradient (s, h) of :func:`_log_integrand` and the Fisher information (ss, sh, hh)."""
    z, g = np.exp(s), np.exp(h)
    spread = z * z / g
    rest, across1, across2 = _of_z(parameters, z)
    of_s, of_h = (
        -(d - DIMENSION + 1) / 2 + d / 2 / z + rest * z / parameters[1],
        (d - DIMENSION + 2 - g) / 2,
    )
    ss, sh, hh = d / 2 / z + z * z / parameters[1], 0.0, g / 2
    for c, k, v in (
        (across1, parameters[4], parameters[6]),
        (across2, parameters[5], parameters[7]),
    ):
        total = v + spread
        share, excess = spread / total, c * c / total - 1
        of_s += share * excess - c * k * z / total
        of_h -= 0.5 * share * excess
        ss += 2 * share * share + (k * z) ** 2 / total
        sh -= share * share
        hh += share * share / 2
    return of_s, of_h, ss, sh, hh


@inner
def _mode(parameters: np.ndarray, d: float) -> tuple[float, float, float, float, float]:
    """A mode (s, h) by Fisher scoring, steps halved where they would descend, and the covariance
    (ss, sh, hh) it suggests.
    """
    # from where the noise-free step would be, or from the law's own middle where that is none
    s, h = np.log(parameters[0] if parameters[0] > 0.1 else 0.1), np.log(d)
    for _ in range(ASCENTS):
        of_s, of_h, ss, sh, hh = _slopes(parameters, d, s, h)
        determinant = ss * hh - sh * sh
        ss, sh, hh = hh / determinant, -sh / determinant, ss / determinant
        step_s, step_h = ss * of_s + sh * of_h, sh * of_s + hh * of_h
        if step_s * of_s + step_h * of_h < SETTLED**2:
            break
        longest = abs(step_s) if abs(step_s) > abs(step_h) else abs(step_h)
        if longest > 1.0:  # no further than a factor e at once
            step_s, step_h = step_s / longest, step_h / longest
        value = _log_integrand(parameters, d, s, h)
        for _ in range(HALVINGS):
            if _log_integrand(parameters, d, s + step_s, h + step_h) >= value:
                s, h = s + step_s, h + step_h
                break
            step_s, step_h = step_s / 2, step_h / 2
    return s, h, ss, sh, hh


@compiled()
def _integrate(
    parameters: np.ndarray,
    d: float,
    xi: np.ndarray,
    weight: np.ndarray,
    result: np.ndarray,
    exponent: np.ndarray,
    root_term: np.ndarray,
    mass: np.ndarray,
    factor: np.ndarray,
) -> None:
    """Fill ``result`` (N,), at the nodes ``xi`` (K,) of ``weight`` (K,) for each of the scaled s
    and h; what is left is room: of (K, K) and (K,).
    """
    half, m, nodes = (d - DIMENSION + 1) / 2, d - DIMENSION + 2, len(xi)
    for n in range(len(parameters)):
        case = parameters[n]
        centre_s, centre_h, ss, sh, hh = _mode(case, d)
        total = top = root_s = root_h = 0.0
        for last in (False, True):
            root_s = np.sqrt(ss)
            slant = sh / root_s
            root_h = np.sqrt(hh - slant * slant)
            # e^h at a node is a product of two factors, and the normal's determinant a square root:
            # one exponential a node is left
            for j in range(nodes):
                factor[j] = np.exp(root_h * xi[j])
            top = -np.inf
            for i in range(nodes):
                s = centre_s + root_s * xi[i]
                z, of_h = np.exp(s), centre_h + slant * xi[i]
                rest, across1, across2 = _of_z(case, z)
                of_s, g_here, squared = (
                    -half * s - d / 2 / z - 0.5 * rest * rest / case[1],
                    np.exp(of_h),
                    z * z,
                )
                across1, across2 = across1 * across1, across2 * across2
                for j in range(nodes):
                    g = g_here * factor[j]
                    spread = squared / g
                    first, second = case[6] + spread, case[7] + spread
                    product = first * second
                    exponent[i, j] = of_s + 0.5 * (
                        m * (of_h + root_h * xi[j])
                        - g
                        - (across1 * second + across2 * first) / product
                    )
                    root_term[i, j] = weight[i] * weight[j] / np.sqrt(product)
                    top = exponent[i, j] if exponent[i, j] > top else top
            total = mean_s = mean_h = 0.0
            for i in range(nodes):
                for j in range(nodes):
                    mass[i, j] = (
                        np.exp(exponent[i, j] - top) * root_term[i, j]
                        if exponent[i, j] > top + FADED
                        else 0.0
                    )
                    total += mass[i, j]
                    mean_s += mass[i, j] * xi[i]
                    mean_h += mass[i, j] * (slant * xi[i] + root_h * xi[j])
            if last:
                break
            mean_s, mean_h = root_s * mean_s / total, mean_h / total
            new_ss = new_sh = new_hh = 0.0
            for i in range(nodes):
                ds = root_s * xi[i] - mean_s
                for j in range(nodes):
                    dh = slant * xi[i] + root_h * xi[j] - mean_h
                    new_ss += mass[i, j] * (ds * ds)
                    new_sh += mass[i, j] * ds * dh
                    new_hh += mass[i, j] * (dh * dh)
            centre_s, centre_h = centre_s + mean_s, centre_h + mean_h
            ss, sh, hh = (
                LEAST_SHARE * ss + new_ss / total,
                LEAST_SHARE * sh + new_sh / total,
                LEAST_SHARE * hh + new_hh / total,
            )
        result[n] = top + np.log(total * root_s * root_h)
