"""The paper's arm, the printed values, and a few paths of the prior."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arm.model import arm_of
from pipeline.cases.verdict import read_claims
from pipeline.studies.published import published
from pipeline.studies.which_decomposition.paths import KINDS, TimeLaw, draw_paths
from pipeline.studies.which_decomposition.stage import PAPER_ARM, robot_of

LAW = TimeLaw(320, 100.0, rest=(0.0, 0.45), ramp=(0.05, 0.35), peak=(0.2, 1.1))


@pytest.fixture(scope="session")
def arm():
    """The chain."""
    return arm_of(robot_of(PAPER_ARM)).chain


@pytest.fixture(scope="session")
def stated():
    """The printed values."""
    return published(read_claims())


@pytest.fixture(scope="session")
def paths(arm, stated):
    """40 paths of every kind, by kind."""
    rng = np.random.default_rng(3)
    return {kind: draw_paths(arm, LAW, kind, stated.u, 40, rng) for kind in KINDS}
