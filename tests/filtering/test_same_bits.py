"""The filter has the same bits on processors of all levels, and beside other threads."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from project_copy import ROOT

PROGRAM = """
import hashlib, sys
from concurrent.futures import ThreadPoolExecutor
import numpy as np
from pipeline.arm.chain import PlanarChain
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.model import Commands
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

MIDDLE, ONE = np.array([1.1, -1.6, 1.8]), np.ones(3)
links = np.array([[0.01, 0.155], [-0.02, 0.135], [0.03, 0.17]])
arm = PlanarChain(np.zeros(2), links, np.array([1.0, -1.0, 1.0]), MIDDLE - 0.13, MIDDLE + 0.13, ONE)
path = MIDDLE + 0.1 * np.sin(0.1 * np.arange(31))[:, None]
v = np.matvec(arm.jacobian(path[:-1]), np.diff(path, axis=0))
seen = Measurements("take", np.arange(3, 31, 3) * 0.01, path[3::3], np.zeros((10, 3)),
    np.tile(1e-5 * np.eye(3), (10, 1, 1)))

def bits(decomposition, share):
    commands = Commands(v, arm.pose(path[:-1]), share)
    posterior = particle_filter(WishartModel(0.25, Decomposition(decomposition)), arm, commands,
        0.01, Start(MIDDLE, 4e-3 * np.eye(3)), seen, FilterOptions(1003), np.random.default_rng(5))
    assert posterior.resampled.any() and posterior.outside.any()
    return posterior.mean.tobytes() + posterior.covariance.tobytes() + posterior.ess.tobytes()

every = [(name, share) for name in ("pivoted_lu", "qr_transposed", "qr")
    for share in (0.0, 0.3)]
with ThreadPoolExecutor(int(sys.argv[1])) as pool:
    results = list(pool.map(lambda each: bits(*each), every))
print(hashlib.sha256(b"".join(results)).hexdigest(), len({*results}))
"""


def has_avx512() -> bool:
    """True where this processor can run code compiled for the newest level."""
    return " avx512vl" in Path("/proc/cpuinfo").read_text(encoding="utf-8")


@pytest.mark.slow
def test_levels_of_processors_and_numbers_of_threads_give_the_same_bits():
    def run(level: str, threads: int) -> str:
        return subprocess.run(
            [sys.executable, "-c", PROGRAM, str(threads)],
            cwd=ROOT,
            env=os.environ | {"NUMBA_CPU_NAME": level},
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    # the first has no instruction that multiplies and adds at once; without AVX-512 the host is of
    # the second level itself
    levels = ["x86-64-v2", *(["x86-64-v3"] if has_avx512() else []), "host"]
    results = {run(level, 1) for level in levels} | {run("host", 2)}
    assert len(results) == 1
    # control: six filters, six results
    assert results.pop().split()[1] == "6"
