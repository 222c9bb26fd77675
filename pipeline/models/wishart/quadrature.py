"""The integral over z and g in the density of a Wishart step with measurement noise.

Over s = ln z and h = ln g. The integrand is narrow where the noise is small and wide where it is
large. The rule follows it (Naylor and Smith, Applied Statistics 31, 1982): centred on its mode and
scaled by its Fisher information there, then by the mean and covariance under that first rule. In
coordinates sinh t the trapezoidal rule converges fast for exponential and normal tails. Compiled,
one step after the other, so that the grid stays in the cache: in NumPy a fit takes ten times as
long.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled, inner

ALONG, DIRECTION = 3, 3  # numbers before those of the directions, and of each direction
RANGE = 3.0  # of t: ± sinh 3 = ± 10 standard deviations
ASCENTS, HALVINGS = 60, 8  # steps of Fisher scoring, and halvings of one, at most
SETTLED = 1e-3  # standard deviations: the mode need not be nearer
LEAST_SHARE = 1e-3  # of the first covariance in the second, where all mass is at one node
FADED = -45.0  # logarithm of the share of the greatest term below which a node has no mass


def log_integrals(numbers: np.ndarray, m: int, d: float, nodes: int) -> np.ndarray:
    """(N,) ln ∫∫ p(z)p(g)·N(y; z, g)·zg ds dh of N steps but for (2π)^{−n/2}, from their
    ``numbers`` of :func:`.density.mixture`; ``nodes`` for each of s and h.
    """
    from scipy.special import gammaln

    shape, freedom = (d - m + 1) / 2, d - m + 2
    t, spacing = np.linspace(-RANGE, RANGE, nodes, retstep=True)
    constant = shape * np.log(d / 2) - gammaln(shape)
    constant -= freedom / 2 * np.log(2) + gammaln(freedom / 2)
    rule, grids = (np.sinh(t), spacing * np.cosh(t)), np.empty((2, nodes, nodes))
    result = np.empty(len(numbers))
    law = float(shape), float(freedom)
    _integrate(numbers, float(d), law, *rule, result, *grids, *np.empty((4, nodes)))
    return result + constant


@inner
def _log_integrand(case: np.ndarray, d: float, law: tuple, s: float, h: float) -> float:
    """ln of the integrand but for what depends neither on s nor on h."""
    (shape, freedom), z = law, np.exp(s)
    spread, rest = z * z * np.exp(-h), z - case[0]
    value = case[1] * rest * rest + np.exp(h) - freedom * h
    for i in range(ALONG, len(case), DIRECTION):
        residual, total = case[i] - z * case[i + 1], 1 + spread * case[i + 2]
        value += residual * residual / total + np.log(total)
    return -shape * s - d / 2 / z - 0.5 * value


@inner
def _slopes(
    case: np.ndarray, d: float, law: tuple, s: float, h: float
) -> tuple[float, float, float, float, float]:
    """Gradient (s, h) of :func:`_log_integrand` and the Fisher information (ss, sh, hh)."""
    (shape, freedom), z, g = law, np.exp(s), np.exp(h)
    spread, squared = z * z / g, case[1] * z * z
    of_s = -shape + d / 2 / z + case[1] * (case[0] - z) * z
    of_h = (freedom - g) / 2
    ss, sh, hh = d / 2 / z + squared, 0.0, g / 2
    for i in range(ALONG, len(case), DIRECTION):
        slope, variance = z * case[i + 1], spread * case[i + 2]
        residual, total = case[i] - slope, 1 + variance
        share, excess = variance / total, residual * residual / total - 1
        of_s += share * excess + residual * slope / total
        of_h -= 0.5 * share * excess
        ss += 2 * share * share + slope * slope / total
        sh -= share * share
        hh += share * share / 2
    return of_s, of_h, ss, sh, hh


@inner
def _mode(case: np.ndarray, d: float, law: tuple) -> tuple[float, float, float, float, float]:
    """A mode (s, h) by Fisher scoring, steps halved where they would descend, and the covariance
    (ss, sh, hh) it suggests.
    """
    # from where the noise-free step would be, or from the law's own middle where that is none
    s, h = np.log(case[0] if case[0] > 0.1 else 0.1), np.log(d)
    for _ in range(ASCENTS):
        of_s, of_h, ss, sh, hh = _slopes(case, d, law, s, h)
        determinant = ss * hh - sh * sh
        ss, sh, hh = hh / determinant, -sh / determinant, ss / determinant
        step_s, step_h = ss * of_s + sh * of_h, sh * of_s + hh * of_h
        if step_s * of_s + step_h * of_h < SETTLED**2:
            break
        longest = abs(step_s) if abs(step_s) > abs(step_h) else abs(step_h)
        if longest > 1.0:  # no further than a factor e at once
            step_s, step_h = step_s / longest, step_h / longest
        value = _log_integrand(case, d, law, s, h)
        for _ in range(HALVINGS):
            if _log_integrand(case, d, law, s + step_s, h + step_h) >= value:
                s, h = s + step_s, h + step_h
                break
            step_s, step_h = step_s / 2, step_h / 2
    return s, h, ss, sh, hh


@compiled
def _integrate(
    numbers: np.ndarray,
    d: float,
    law: tuple,
    xi: np.ndarray,
    weight: np.ndarray,
    result: np.ndarray,
    exponent: np.ndarray,
    mass: np.ndarray,
    factor: np.ndarray,
    spread: np.ndarray,
    squares: np.ndarray,
    product: np.ndarray,
) -> None:
    """Fill ``result`` (N,), at the nodes ``xi`` (K,) of ``weight`` (K,) for each of the scaled s
    and h; the others are buffers (K, K) and (K,).
    """
    (shape, freedom), nodes = law, len(xi)
    # the normal's determinant stands apart from the exponent, a root for each direction
    faded = FADED * max(1, (numbers.shape[1] - ALONG) // DIRECTION - 1)
    for n in range(len(numbers)):
        case = numbers[n]
        centre_s, centre_h, ss, sh, hh = _mode(case, d, law)
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
                s, of_h = centre_s + root_s * xi[i], centre_h + slant * xi[i]
                z, g = np.exp(s), np.exp(of_h)
                rest, squared = z - case[0], z * z / g
                of_s = -shape * s - d / 2 / z - 0.5 * case[1] * rest * rest
                for j in range(nodes):
                    spread[j], squares[j], product[j] = squared / factor[j], 0.0, 1.0
                for k in range(ALONG, len(case), DIRECTION):
                    residual, size = case[k] - z * case[k + 1], case[k + 2]
                    residual *= residual
                    for j in range(nodes):
                        scale = 1 + spread[j] * size
                        squares[j] += residual / scale
                        product[j] *= scale
                for j in range(nodes):
                    value = freedom * (of_h + root_h * xi[j]) - g * factor[j] - squares[j]
                    exponent[i, j] = of_s + 0.5 * value
                    mass[i, j] = weight[i] * weight[j] / np.sqrt(product[j])
                for j in range(nodes):
                    top = exponent[i, j] if exponent[i, j] > top else top
            total = mean_s = mean_h = 0.0
            for i in range(nodes):
                for j in range(nodes):
                    mass[i, j] *= (
                        np.exp(exponent[i, j] - top) if exponent[i, j] > top + faded else 0.0
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
        result[n] = top + np.log(total * root_s * root_h) - 0.5 * case[2]
