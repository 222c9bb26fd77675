"""How the Wishart model moves one particle, written for JAX to vectorise and compile: the exact law
of a step of a planar arm by the LU decomposition, of an arm in space by QR of Jᵀ.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

ROWS = 6  # m in space

jax.config.update("jax_enable_x64", True)


def law_of(pivoted=None, links=None, signs=None, placements=None, *, sigma_b, **told) -> Callable:
    """``move(key, q, command)`` (n,) of the arm that `scenario.Take.told` tells of."""
    if links is not None:
        return planar(np.array(links), np.array(signs), pivoted, 4 / sigma_b**2)
    return spatial(np.array(placements), (ROWS + 1) / sigma_b**2)


def planar(links: np.ndarray, signs: np.ndarray, pivoted: bool, d: float) -> Callable:
    """Of three joints, as `wishart_take.WishartTake.closed_form`."""

    def move(key, q, v):
        heading = jnp.cumsum(q * signs)
        sine, cosine = jnp.sin(heading), jnp.cos(heading)
        x = cosine * links[:, 0] + sine * links[:, 1]
        z = cosine * links[:, 1] - sine * links[:, 0]
        first = signs * jnp.cumsum(z[::-1])[::-1]
        second = -signs * jnp.cumsum(x[::-1])[::-1]
        rows = [jnp.append(first, v[0]), jnp.append(second, v[1]), jnp.append(signs, v[2])]
        one, two, three = eliminated(rows, pivoted)
        step = inverse_action(key, jnp.stack([one[3], two[3], three[3]]), d)
        c = step[2] / three[2]
        b = (step[1] - two[2] * c) / two[1]
        return q + jnp.stack([(step[0] - one[1] * b - one[2] * c) / one[0], b, c])

    return move


def eliminated(rows: list, pivoted: bool) -> list:
    """The rows (4,) of [U, J₁⁻¹v] of [J, v], with partial pivoting or without."""
    one, two, three = rows
    if pivoted:
        one, two = larger_first(one, two, 0)
        one, three = larger_first(one, three, 0)
    two, three = two - two[0] / one[0] * one, three - three[0] / one[0] * one
    if pivoted:
        two, three = larger_first(two, three, 1)
    return [one, two, three - three[1] / two[1] * two]


def larger_first(one, two, column: int) -> tuple:
    exchanged = jnp.abs(two[column]) > jnp.abs(one[column])
    return jnp.where(exchanged, two, one), jnp.where(exchanged, one, two)


def spatial(placements: np.ndarray, d: float) -> Callable:
    """Of any number of joints, as `arm_in_space.SpatialTake.move`."""
    turns, ways = placements[:, :9].reshape(-1, 3, 3), placements[:, 9:]
    joints = len(turns) - 1

    def move(key, q, command):
        sine, cosine = jnp.sin(q), jnp.cos(q)
        turned, point = jnp.eye(3), jnp.zeros(3)
        axes, points = [], []
        for j in range(joints):
            point = point + turned @ ways[j]
            a, b, c = (turned @ turns[j]).T
            axes.append(c)
            points.append(point)
            turned = jnp.stack([a * cosine[j] + b * sine[j], b * cosine[j] - a * sine[j], c]).T
        tip = point + turned @ ways[joints]
        columns = [
            jnp.concatenate([jnp.cross(axis, tip - point), axis])
            for axis, point in zip(axes, points, strict=True)
        ]
        lower, rows = factorised(jnp.stack(columns).T)
        step = inverse_action(key, solved(lower, command[:ROWS]), d)
        w = command[ROWS:]
        if len(w) == 0:
            return q + rows.T @ step
        return q + w + rows.T @ (step - rows @ w)

    return move


def factorised(jacobian) -> tuple:
    """L, as its rows, and Q (6, n) of J = LQ, by Gram–Schmidt."""
    lower, axes = [], []
    for row in jacobian:
        shares = []
        for axis in axes:
            shares.append(row @ axis)
            row = row - shares[-1] * axis
        shares.append(jnp.sqrt(row @ row))
        axes.append(row / shares[-1])
        lower.append(shares)
    return lower, jnp.stack(axes)


def solved(lower: list, v):
    """(6,) solution of Lx = v."""
    x = []
    for row, right in zip(lower, v, strict=True):
        x.append((right - sum(a * b for a, b in zip(row, x, strict=False))) / row[-1])
    return jnp.stack(x)


def inverse_action(key, a, d: float):
    """(m,) B⁻¹a: two χ² and m − 1 normals."""
    m = len(a)
    keys = jax.random.split(key, 3)
    z = d / jax.random.chisquare(keys[0], d - m + 1)
    t = jax.random.normal(keys[1], (m - 1,)) / jnp.sqrt(jax.random.chisquare(keys[2], d - m + 2))
    r = jnp.sqrt(a @ a)
    # R by the Householder reflection that takes the first axis to ±a/r
    mirror = a.at[0].add(jnp.copysign(r, a[0]))
    action = a - (mirror[1:] @ t) / (r + jnp.abs(a[0])) * mirror
    return z * action.at[1:].add(r * t)
