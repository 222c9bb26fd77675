"""Machine code: the same bits on processors of all levels and beside other threads, and loops that
take several poses at once. Where a loop reads the wrong axis, or LLVM cannot see that rows do not
overlap, it takes one pose at a time: two to seven times as long.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from compiled_calls import from_python
from project_copy import ROOT
from space_arms import revolute_arm

from pipeline.arm import kinematics, rows
from pipeline.arm.rows import block_rows
from pipeline.models import kernel
from pipeline.models.draws import compiled_arm

PROGRAM = """
import hashlib, sys
from concurrent.futures import ThreadPoolExecutor
from test_particle_filter import *

def bits(decomposition, share):
    law = WishartModel(0.25, READINGS[decomposition])
    posterior = on_the_scene(particle_filter, law, ARM, filter_options(1003), share, default_rng(5))
    assert posterior.resampled.any() and (share or posterior.outside.any())
    return posterior.mean.tobytes() + posterior.covariance.tobytes() + posterior.ess.tobytes()

cases = [(name, share) for name in ("pivoted_lu", "qr_transposed", "qr") for share in (0.0, 0.3)]
with ThreadPoolExecutor(int(sys.argv[1])) as pool:
    results = list(pool.map(lambda case: bits(*case), cases))
print(hashlib.sha256(b"".join(results)).hexdigest(), len({*results}))
"""


@pytest.mark.slow
def test_levels_of_processors_and_numbers_of_threads_give_the_same_bits():
    """The host's own level in two threads, and the next below it that it has in one."""

    def run(level: str, threads: int) -> str:
        places = [
            str(ROOT / name) for name in (".", "tests/helpers", "tests/filtering")
        ]
        setting = {"NUMBA_CPU_NAME": level, "PYTHONPATH": os.pathsep.join(places)}
        command = [sys.executable, "-c", PROGRAM, str(threads)]
        return subprocess.check_output(
            command,
            cwd=ROOT,
            env=os.environ | setting,
            text=True,
        )

    newest = " avx512vl" in Path("/proc/cpuinfo").read_text(encoding="utf-8")
    below = "x86-64-v3" if newest else "x86-64-v2"
    bits, different = run("host", 2).split()
    bits_below = run(below, 1).split()

    # control: six filters, six results
    assert bits_below == [bits, different] and different == "6"


def wide(function, *arguments) -> bool:
    """True where products of several numbers are taken at once, in AVX and wider."""
    call = from_python(function)
    call(*arguments)
    vector = re.compile(r"vmulpd\s.*%[yz]mm")
    return all(vector.search(assembly) for assembly in call.inspect_asm().values())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_loops_of_a_step_take_several_poses_at_once():
    arm = revolute_arm(7)
    places = block_rows(7, 6)
    constants, block = compiled_arm(arm)
    q = np.zeros((7, 256))
    first = places.jacobian
    loops = {
        "tip": (kinematics.tip, constants, q, 0, 64, block),
        "Jacobian": (kinematics.task_jacobian, constants, block, first, 64),
        "sums of products": (rows.add_dot, block, 0, 1.0, 1, 9, 6, 64),
        "combinations": (rows.add_combination, block, 0, np.ones(9), 0, 1, 7, 64),
        "action": (kernel.act, 64.0, block, places, 3, 64),
    }

    assert [name for name, call in loops.items() if not wide(*call)] == []

    # control: poses that wait for each other are taken one by one
    @numba.njit
    def chained(block, factor):
        for i in range(1, 64):
            block[0, i] = factor * block[0, i - 1]

    assert not wide(chained, np.ones((1, 64)), 0.5)
