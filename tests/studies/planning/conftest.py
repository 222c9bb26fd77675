"""The youBot with the task x, z on the bench, and the arm of its takes in the base condition."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pipeline.core.config import CONF
from pipeline.studies.planning.bench import Bench, Rig, bench_of


@pytest.fixture(scope="session")
def bench() -> Bench:
    own = bench_of(CONF / "dataset/youbot.yaml", ["x", "z"], 0.64)
    # 200 steps of the servo a second show what is asked here
    return replace(own, dynamics=replace(own.dynamics, rate=200.0))


@pytest.fixture(scope="session")
def rig(bench) -> Rig:
    return Rig(bench, bench.dynamics, takes=6, seed=1)
