"""The compiled steps of a planar arm compute several poses at once. Where a loop reads an array
in a branch, or slices one, the compiler takes one pose at a time: six times as long.
"""

from __future__ import annotations

import re

import numba
import pytest

from pipeline.models.additive import step as additive
from pipeline.models.gaussian import step as gaussian
from pipeline.models.law import STEP
from pipeline.models.scaled import step as scaled
from pipeline.models.wishart import step as wishart

LAWS = [
    additive.planar_additive,
    gaussian.planar_gaussian,
    scaled.planar_scaled,
    wishart.given_factor,
    wishart.qr_transposed,
    wishart.pivoted_lu,
]
# products of several numbers at once
WIDE = re.compile(r"fmul <\d+ x double>")


def code(function) -> str:
    """What the compiler makes of ``function`` as a step."""
    law = numba.njit(STEP.signature, error_model="numpy")(function)
    return law.inspect_llvm(law.signatures[0])


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{law.__module__}.{law.__name__}")
def test_a_planar_law_takes_several_poses_at_once(law):
    assert WIDE.search(code(law.py_func))


@pytest.mark.slow
def test_poses_that_wait_for_each_other_are_taken_one_by_one():
    def chained(numbers, parameters, arm, poses):
        for i in range(1, poses.count):
            poses.moved[0, i] = parameters[0] * poses.moved[0, i - 1]
        return 0

    assert not WIDE.search(code(chained))
