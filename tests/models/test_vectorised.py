"""The loops of a compiled step take several poses at once. Where a loop reads the wrong axis, or
LLVM cannot see that rows do not overlap, it takes one pose at a time: two to seven times as long.
"""

from __future__ import annotations

import re

import numba
import numpy as np
import pytest
from compiled_calls import from_python
from space_arms import revolute_arm

from pipeline.arm import kinematics, planar, rows
from pipeline.arm.rows import block_rows
from pipeline.models import kernel
from pipeline.models.draws import block_for

# products of several numbers at once, in AVX and wider
WIDE = re.compile(r"vmulpd\s.*%[yz]mm")
SPATIAL = revolute_arm(7)
ROWS = block_rows(7, 6)
POSES = np.zeros((7, 256))


def wide(function, *arguments) -> bool:
    call = from_python(function)
    call(*arguments)
    return all(WIDE.search(assembly) for assembly in call.inspect_asm().values())


def calls(chain) -> dict:
    """Loops of a step, with arguments."""
    flat, block, first = block_for(chain), block_for(SPATIAL), ROWS.jacobian
    q, arm, space = np.zeros((3, 256)), chain.numbers(), SPATIAL.numbers()
    return {
        "planar Jacobian": (planar.planar_jacobian, arm, q, 0, 256, flat),
        "planar steps": (planar.planar_steps, arm, flat, 256),
        "planar norm": (planar.planar_inverse_square, flat, 256),
        "tip": (kinematics.tip, space, POSES, 0, 64, block),
        "Jacobian": (kinematics.task_jacobian, space, block, first, 64),
        "sums of products": (rows.add_dot, block, 0, 1.0, 1, 9, 6, 64),
        "combinations": (rows.add_combination, block, 0, np.ones(9), 0, 1, 7, 64),
        "action": (kernel.act, 64.0, block, ROWS, 3, 64),
    }


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_loops_of_a_step_take_several_poses_at_once(chain):
    one_by_one = [name for name, call in calls(chain).items() if not wide(*call)]
    assert one_by_one == []


@pytest.mark.slow
def test_poses_that_wait_for_each_other_are_taken_one_by_one():
    @numba.njit
    def chained(block, factor):
        for i in range(1, 64):
            block[0, i] = factor * block[0, i - 1]

    assert not wide(chained, np.ones((1, 64)), 0.5)
