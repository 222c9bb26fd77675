"""The likelihood recovers the reading that made the numbers, and has no preference without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.studies.which_decomposition.evidence import (
    SETS,
    SIZES,
    Widths,
    densities,
    evidence_rows,
    joined,
    log_quantities,
    widths,
)
from pipeline.studies.which_decomposition.laws import (
    PIVOTED,
    QR_TRANSPOSED,
    READINGS,
)

ALL = (*SIZES["all joints"], *SETS["small_difference"])


@pytest.fixture(scope="module")
def drawn(arm, paths, stated):
    """Both models on all paths."""
    return joined([widths(arm, part, stated, kind) for kind, part in paths.items()])


def made_by(drawn, stated, reading, path):
    """The numbers that would have been printed, had ``reading`` been used on ``path``; the two
    models alike.
    """
    joints = drawn.wishart[READINGS.index(reading), path]
    total = np.sqrt(np.mean(joints**2))
    alike = replace(drawn, gaussian=drawn.gaussian * total / drawn.gaussian[path])
    return alike, replace(stated, covariance=np.diag(joints**2))


@pytest.mark.parametrize("reading", [PIVOTED, "lu_xzp", "lu_zxp", QR_TRANSPOSED])
def test_the_reading_that_made_the_numbers_is_the_most_likely_on_its_path(drawn, stated, reading):
    number, found = READINGS.index(reading), []
    for path in range(0, 120, 6):
        models, printed = made_by(drawn, stated, reading, path)
        quantities = log_quantities(models, printed)
        density = densities(quantities, ALL, 1.1)
        # the path itself is one of the prior's, and the numbers are met there exactly
        assert density[number, path] == density.max()
        likelihood = density.mean(axis=1)
        found.append(likelihood[number] >= 0.99 * likelihood.max())
    assert np.mean(found) >= 0.7


def test_laws_that_are_equal_have_equal_likelihoods(drawn, stated):
    same = replace(drawn, wishart=np.broadcast_to(drawn.wishart[:1], drawn.wishart.shape))
    rows = evidence_rows(same, stated, [1.5, 2.0], (1.25, 3.0))
    np.testing.assert_allclose(rows[["likelihood", "low", "high"]], 1.0, rtol=1e-12)


def test_the_likelihood_is_the_mean_of_normal_densities(stated):
    wishart = np.full((len(READINGS), 2, 3), stated.spread) * np.array([1.0, 2.0])[:, None]
    gaussian = np.full(2, np.sqrt(np.trace(stated.covariance) / 3))
    two = Widths(np.array(["loop"] * 2), np.zeros(2), gaussian, wishart)
    density = densities(log_quantities(two, stated), ("joint 1", "gaussian"), 2.0)
    at_zero = 1 / (2 * np.pi * np.log(2) ** 2)
    np.testing.assert_allclose(density, np.tile([at_zero, at_zero * np.exp(-0.5)], (9, 1)))


def test_pivoted_lu_is_more_than_twice_as_wide_as_the_gaussian_model_on_every_path(drawn):
    difference = dict(zip(READINGS, drawn.difference, strict=True))
    assert difference[PIVOTED].min() > 2.2 and difference["qr"].min() > 2.5
    # the control: LU without pivoting is as wide as the Gaussian model on some
    assert difference["lu_xzp"].min() < 0.9 < 1.1 < np.median(difference["lu_xzp"])
