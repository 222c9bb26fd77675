"""The paper's arm with its steps a second, the published values, and a few random paths."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.cases.verdict import read_claims
from pipeline.studies.factors.paths import draw_paths, quadrature
from pipeline.studies.factors.stage import paper_arm
from pipeline.studies.published import published


@pytest.fixture(scope="session")
def arm():
    """The chain, and steps a second."""
    return paper_arm()


@pytest.fixture(scope="session")
def stated():
    """The published values."""
    return published(read_claims())


@pytest.fixture(scope="session")
def paths(arm, stated):
    """Those of 300 random paths that keep the bound, at 16 poses."""
    chain, rate = arm
    rng = np.random.default_rng(3)
    return draw_paths(chain, rate, stated.u, 300, quadrature(16)[0], rng)
