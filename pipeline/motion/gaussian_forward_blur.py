"""The density of x + ε, x = A⁻¹v with A ~ N_{n,n}(J̲, I⊗sI) and ε ~ N(0, C) the measurement noise, by quadrature.

Of p(y) = ∫ p(x)·N(y − x; C) dx no part is normal, for x has tails like ‖x‖⁻⁴. In x = ±eᵗd, d = e + Uw, with e a unit vector and U
a basis of e⊥, the costly factor E|det G| depends on w alone, and what is left is a sum of powers of eᵗ with coefficients that depend
on w. So the rule takes w outside, t inside, and both signs at once: one of either is the step against the command.

The rule follows the integrand (Naylor and Smith, Applied Statistics 31, 1982): centred on its mode, scaled by the information there,
then by its own mean and covariance under that first rule. In scaled coordinates sinh τ it is a trapezoidal rule in τ.
"""

from __future__ import annotations

import numpy as np

from pipeline.motion.gaussian_forward_density import crossing
from pipeline.motion.wishart_density import frames

FIRST = (7, 11)  # nodes for each coordinate of w, and for t, of the first rule
NODES = (11, 19)  # and of the second
RANGES = (3.0, 3.4)  # of τ for w and t: ± 10 and ± 15 standard deviations
WIDEST = (2.0, 2.0, 1.0)  # information on w and t that the form of the law alone gives: tails of power laws in w, exponential ones in t
ASCENTS = 30  # scoring steps at most
LEAST_STEP = 1e-3  # of the nominal step's length: a measured step below it is no place to start from
SETTLED = 1e-2  # of a standard deviation: the mode need not be nearer
LEAST_SHARE = 1e-3  # of the first covariance in the second: all mass at one node is no reason for none
FAR = 100.0  # of |t|: nothing lies beyond e^±100 rad, and squares of that are still numbers
BLOCK = 32  # steps at a time, so that the grids stay in the cache


def _ascend(
    x: np.ndarray, y: np.ndarray, v: np.ndarray, jacobian: np.ndarray, s: np.ndarray, precision: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, 3) a mode of ‖x‖⁻⁴·exp{−‖v − J̲x‖²/(2s‖x‖²)}·N(y − x; C) by Gauss and Newton from ``x``, its value (N,)
    and information (N, 3, 3)."""

    def value(x: np.ndarray) -> np.ndarray:
        squared, miss, gap = np.vecdot(x, x), v - np.matvec(jacobian, x), y - x
        return -2 * np.log(squared) - np.vecdot(miss, miss) / (2 * s * squared) - 0.5 * np.vecdot(gap, gap @ precision)

    def slopes(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        squared = np.vecdot(x, x)[:, None]
        r = np.sqrt(squared)
        miss = (v - np.matvec(jacobian, x)) / r
        derivative = -jacobian / r[..., None] - miss[:, :, None] * x[:, None, :] / squared[..., None]
        turned = np.swapaxes(derivative, -1, -2)
        gradient = (y - x) @ precision - np.matvec(turned, miss) / s[:, None] - 4 * x / squared
        return gradient, precision + turned @ derivative / s[:, None, None]

    best = value(x)
    for _ in range(ASCENTS):
        gradient, information = slopes(x)
        step = np.linalg.solve(information, gradient[..., None])[..., 0]
        if np.vecdot(step, gradient).max() < SETTLED**2:
            break
        for _ in range(8):
            descends = ~(value(x + step) >= best)
            if not descends.any():
                break
            step = np.where(descends[:, None], step / 2, step)
        tried = value(x + step)
        x, best = np.where((tried >= best)[:, None], x + step, x), np.maximum(tried, best)
    return x, best, slopes(x)[1]


def _mode(y: np.ndarray, v: np.ndarray, jacobian: np.ndarray, s: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) the higher of the modes that are reached from the measured and from the nominal step, and the information (N, 3, 3) there.

    Between a step against the command and the nominal one lies the origin, which no ascent crosses.
    """
    nominal = np.linalg.solve(jacobian, v[..., None])[..., 0]
    near = np.vecdot(y, y) > LEAST_STEP**2 * np.vecdot(nominal, nominal)
    x, best, information = _ascend(np.where(near[:, None], y, nominal), y, v, jacobian, s, precision)
    other = _ascend(nominal, y, v, jacobian, s, precision)
    higher = other[1] > best
    return np.where(higher[:, None], other[0], x), np.where(higher[:, None, None], other[2], information)


def _rule(nodes: int, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and log weights (``nodes``,) of the trapezoidal rule in τ for an integral over sinh τ."""
    tau, step = np.linspace(-reach, reach, nodes, retstep=True)
    return np.sinh(tau), np.log(step * np.cosh(tau))


def _integral(
    y: np.ndarray, v: np.ndarray, jacobian: np.ndarray, s: np.ndarray, measurement: np.ndarray, nodes: tuple[int, int]
) -> np.ndarray:
    precision = np.linalg.inv(measurement)
    place, information = _mode(y, v, jacobian, s, precision)
    r = np.sqrt(np.vecdot(place, place))
    basis = np.roll(frames(place), -1, axis=-1)  # U, e
    scaled = r[:, None, None] * basis
    covariance = np.linalg.inv(np.swapaxes(scaled, -1, -2) @ information @ scaled + np.diag(WIDEST))
    centre = np.stack([np.zeros_like(r), np.zeros_like(r), np.log(r)], axis=-1)
    speed, distance = np.vecdot(v, v)[:, None, None], np.vecdot(y, y @ precision)
    for of_w, of_t in (FIRST, nodes):
        root = np.linalg.cholesky(covariance)
        (xi, weight_w), (tau, weight_t) = _rule(of_w, RANGES[0]), _rule(of_t, RANGES[1])
        first, second = (grid.ravel() for grid in np.meshgrid(xi, xi, indexing="ij"))
        grid = np.stack([first, second], axis=-1)
        w = centre[:, None, :2] + grid @ np.swapaxes(root[:, :2, :2], -1, -2)
        t = (centre[:, 2:] + root[:, 2, :2] @ grid.T)[..., None] + root[:, 2, 2, None, None] * tau
        direction = np.concatenate([w, np.ones_like(w[..., :1])], axis=-1) @ np.swapaxes(basis, -1, -2)
        image = direction @ np.swapaxes(jacobian, -1, -2)
        squared = np.vecdot(direction, direction)
        spread = s[:, None] * squared
        of_direction = np.log(crossing(jacobian, v, direction, s)) - 2 * np.log(squared) - np.vecdot(image, image) / (2 * spread)
        of_direction += (weight_w[:, None] + weight_w).ravel()
        ahead = ((image @ v[..., None])[..., 0] / spread)[..., None]
        towards = direction @ (y @ precision)[..., None]
        across = np.vecdot(direction, direction @ precision)[..., None]
        reach = np.exp(np.clip(t, -FAR, FAR))
        odd = np.abs(ahead / reach + towards * reach)
        even = -speed / (2 * spread[..., None] * reach**2) - 0.5 * across * reach**2
        values = of_direction[..., None] + even + odd + np.log1p(np.exp(-2 * odd)) - t + weight_t
        top = values.max(axis=(1, 2), keepdims=True)
        mass = np.exp(values - top)
        total = mass.sum(axis=(1, 2))
        log_integral = top[:, 0, 0] + np.log(total) + np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
        mass /= total[:, None, None]
        of_nodes = mass.sum(axis=2)
        mean_t = (mass * t).sum(axis=(1, 2))
        centre = np.concatenate([np.matvec(np.swapaxes(w, -1, -2), of_nodes), mean_t[:, None]], axis=-1)
        dw, dt = w - centre[:, None, :2], t - mean_t[:, None, None]
        covariance = LEAST_SHARE * covariance
        covariance[:, :2, :2] += np.swapaxes(dw, -1, -2) @ (of_nodes[..., None] * dw)
        covariance[:, 2, 2] += (mass * dt**2).sum(axis=(1, 2))
        mixed = np.matvec(np.swapaxes(dw, -1, -2), (mass * dt).sum(axis=2))
        covariance[:, :2, 2] += mixed
        covariance[:, 2, :2] += mixed
    constant = (
        0.5 * np.log(speed[:, 0, 0]) - 1.5 * np.log(2 * np.pi * s) - 1.5 * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(measurement)[1]
    )
    return log_integral + constant - 0.5 * distance


def blurred_log_density(
    y: np.ndarray, v: np.ndarray, jacobian: np.ndarray, s: np.ndarray, measurement: np.ndarray, nodes: tuple[int, int] = NODES
) -> np.ndarray:
    """(N,) log density of A⁻¹v + ε at ``y`` (N, 3), for ``v`` (N, 3) not zero, regular ``jacobian`` J̲ (N, 3, 3) and positive ``s`` (N,).

    ``measurement`` C (3, 3), positive definite; ``nodes`` for each coordinate of w, and for t. The defaults leave a relative error of the
    density of 1e-3, and of up to some hundredths for a command that is small beside the measurement noise.
    """
    blocks = [slice(start, start + BLOCK) for start in range(0, len(y), BLOCK)]
    values = [_integral(y[i], v[i], jacobian[i], s[i], measurement, nodes) for i in blocks]
    return np.concatenate(values) if values else np.zeros(0)
