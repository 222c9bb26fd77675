"""Errata of the depth camera: what the commanded end-effector does to the joint angles."""

from __future__ import annotations

import numpy as np
from made_options import made
from rectangle_clouds import CHAIN, cloud

from pipeline.core.options.analysis import ArticulationSection
from pipeline.perception.articulation import fit_sequence

POSE = np.radians([-20.0, 100.0, -25.0])
DEVIATION = 0.03  # rad
FRAMES = 240


def slopes(end: str) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) slopes of the errors of the joint angles on the deviations of the joints, and their
    standard errors, of an arm that is commanded to stay at POSE and deviates from it.
    """
    rng = np.random.default_rng(9)
    d = rng.normal(scale=DEVIATION, size=(FRAMES, 3))
    clouds = [cloud(POSE + deviation, rng, points=600) for deviation in d]
    ee = np.broadcast_to(CHAIN.points(POSE)[3], (FRAMES, 2))
    options = made(ArticulationSection, end_point=end)
    error = fit_sequence(clouds, CHAIN.origin, ee, CHAIN, options, POSE).q - POSE - d
    design = np.column_stack([np.ones(FRAMES), d])
    inverse = np.linalg.inv(design.T @ design)
    fit = inverse @ design.T @ error
    rest = error - design @ fit
    variance = np.outer(np.diag(inverse), (rest**2).sum(axis=0) / (FRAMES - 4))
    return fit[1:].T, np.sqrt(variance[1:]).T


def test_with_the_commanded_end_the_error_depends_on_the_deviation_and_with_the_fitted_one_not():
    # 4 standard errors: of nine slopes one is that far off in two thousand tests
    slope, error = slopes("fitted")
    assert np.all(np.abs(slope) < 4 * error)
    assert np.all(error < 0.2)
    # the control, and the erratum: with the commanded end every joint's error depends on one at
    # least, those of the last two on each of them by more than the standard errors could hide
    slope, error = slopes("commanded")
    assert np.all(np.any(np.abs(slope) > 4 * error, axis=1))
    assert np.all(np.abs(slope[1:]) > 0.6)
