"""Paths that the arm cannot take are left out; a covariance that a sway can have fits."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.laboratory.swing import desired_joints
from pipeline.models.norm import frobenius
from pipeline.studies.principles import paths
from pipeline.studies.principles.paths import candidates, misfit, shares

WAY, U, DRAWS = 1.0, 18.0, 60_000


def draw(chain, u: float = U) -> tuple[np.ndarray, np.ndarray]:
    """Ends (P, n) of the paths, and (P, 9, n) poses along them in rad."""
    start, end = candidates(chain, WAY, u, DRAWS, np.random.default_rng(7))
    q = start[:, None] + np.linspace(0, 1, 9)[:, None] * (end - start)[:, None]
    return np.stack([start, end], axis=1), q


def opening(chain, q: np.ndarray) -> np.ndarray:
    """(P,) m, by which the tip is farther from the first joint at the end than at the start."""
    reach = np.linalg.norm(chain.pose(q)[..., :2] - chain.origin, axis=-1)
    return reach[:, -1] - reach[:, 0]


def lowest(chain, q: np.ndarray) -> np.ndarray:
    """(P,) m, height of the lowest joint or the tip."""
    return chain.points(q)[..., 1].min(axis=(1, 2))


def off_level(chain, q: np.ndarray) -> np.ndarray:
    """(P,) m, least height of the tip over or under the first joint."""
    return np.abs(chain.pose(q)[..., 1] - chain.origin[1]).min(axis=1)


def parts(chain, q: np.ndarray) -> np.ndarray:
    """(P, 9, n, 21, 2) m, points all along the segments."""
    nodes, share = chain.points(q), np.linspace(0, 1, 21)[:, None]
    return nodes[:, :, :-1, None] + share * np.diff(nodes, axis=2)[:, :, :, None]


def gap(chain, q: np.ndarray) -> np.ndarray:
    """(P,) m, least distance of the tool, without what lies in the wrist, from the first link."""
    points = parts(chain, q)
    away = points[:, :, 0, :, None] - points[:, :, -1, None, 4:]
    return np.linalg.norm(away, axis=-1).min(axis=(1, 2, 3))


def beside(chain, q: np.ndarray) -> np.ndarray:
    """(P,) m, least distance to the side of the first joint of what is below it."""
    x, z = np.moveaxis(parts(chain, q) - chain.origin, -1, 0)
    return np.where(z < -0.01, np.abs(x), np.inf).min(axis=(1, 2, 3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("constant", "without", "measure", "others"),
    [
        ("OPENING", -1.0, opening, {}),
        ("FLOOR", -1.0, lowest, {}),
        ("LEVEL", 0.0, off_level, {}),
        ("APART", 0.0, gap, {"OPENING": -1.0}),
        ("COLUMN", 0.0, beside, {"FLOOR": -1.0, "LEVEL": 0.0}),
    ],
)
def test_a_path_that_comes_too_near_is_left_out(
    chain, monkeypatch, constant, without, measure, others
):
    """``others`` are limits without which this one has something to leave out."""
    for name, value in others.items():
        monkeypatch.setattr(paths, name, value)
    # the code looks at points of the segments 2 cm apart: between them there is a little less room
    least = getattr(paths, constant) - {gap: 0.002, beside: 0.01}.get(measure, 1e-9)
    assert np.all(measure(chain, draw(chain)[1]) >= least)
    # control: without this limit some come nearer
    monkeypatch.setattr(paths, constant, without)
    assert np.any(measure(chain, draw(chain)[1]) < least)


def test_the_paths_are_of_one_way_within_the_joints_and_conditioned_as_published(chain):
    ends, q = draw(chain)
    assert len(ends) > 10
    np.testing.assert_allclose(np.abs(ends[:, 1] - ends[:, 0]), WAY)
    assert chain.within_limits(q).all() and not chain.singular(q).any()
    assert frobenius(chain.inverse_jacobian(q)).max() <= U
    # control: with a greater bound there are others
    _, wider = draw(chain, 2 * U)
    assert frobenius(chain.inverse_jacobian(wider)).max() > U


@pytest.mark.parametrize("exponent", [0.0, 2.0])
def test_the_shares_are_the_covariance_of_a_sway_through_the_inverse_jacobian(
    chain, motion, exponent
):
    folded, extended = np.array(motion.folded), np.array(motion.extended)
    share, std = shares(chain, motion, folded, extended, exponent), np.array([3e-4, 2e-3, 0.03])
    rng, draws = np.random.default_rng(3), 200
    steps = round(motion.duration * motion.rate)
    q, speed = desired_joints((np.arange(steps) + 0.5) / motion.rate, motion)
    pace = np.linalg.norm(speed, axis=1) / np.linalg.norm(chain.max_speed)
    sway = std * pace[:, None] ** exponent * rng.standard_normal((draws, steps, 3))
    noise = np.linalg.solve(chain.jacobian(q), sway[..., None])[..., 0].reshape(-1, 3)
    stated = np.einsum("i,ijk->jk", std**2, share)
    size = np.sqrt(np.diag(stated))
    # 200 draws of some hundred moving steps
    error = np.abs(noise.T @ noise / len(noise) - stated) / np.outer(size, size)
    band = 4.5 * np.sqrt(2 / (draws * 100))
    assert error.max() < band
    # control: the rows of the task do not give alike
    swapped = np.einsum("i,ijk->jk", std[::-1] ** 2, share)
    assert (np.abs(swapped - stated) / np.outer(size, size)).max() > band


def test_what_a_sway_and_a_clearance_make_fits_and_nothing_else(chain, motion):
    share = shares(chain, motion, np.array(motion.folded), np.array(motion.extended), 2.0)
    made = np.einsum("i,ijk->jk", np.array([3e-4, 2e-3, 0.03]) ** 2, share)
    made[-1, -1] *= 1.5  # a third of it is the clearance's
    assert misfit(share, made, 0.4) < 1e-8
    # controls: less clearance than there is, and joints that move against each other otherwise
    assert misfit(share, made, 0.1) > 1e-3
    turned = made * np.outer([1, -1, 1], [1, -1, 1])
    assert misfit(share, turned, 0.4) > 1.0
