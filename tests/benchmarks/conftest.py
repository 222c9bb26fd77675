"""Contests with a peer, which runs in a process of its own interpreter; sizes for measuring or for
trying.

A contest is one group of pytest-benchmark, named by a sentence. Each of its tests states in
``benchmark.extra_info`` its ``role`` ("ours" or "peer"), the ``items`` that one call treats and,
where its result has a quality, its ``error`` or ``objective`` (less is better); a peer also its
``configuration`` and the ``target``, the least ratio of its time an item to ours.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

# last, so that tests/conftest.py stays what other tests find by that name
sys.path += [str(Path(__file__).parent), str(Path(__file__).parent / "peers")]
from peer_process import INTERPRETER, PeerProcess


@pytest.fixture
def size(benchmark: BenchmarkFixture) -> Callable[[int, int], int]:
    """Return ``size(measured, tried)``: the size of a problem for `make bench`, or for `make test`,
    which runs ours once, unmeasured (--benchmark-disable in pyproject.toml).
    """
    return lambda measured, tried: tried if benchmark.disabled else measured


@pytest.fixture
def peer(benchmark: BenchmarkFixture) -> Iterator[Callable[..., PeerProcess]]:
    """Return ``peer(NAME, **options)``, which starts peers/NAME.py and calls its setup."""
    if benchmark.disabled:
        pytest.skip("importing the peers takes seconds each; `make bench` runs them")
    if not INTERPRETER.exists():
        pytest.skip("the peers' environment is missing; `make bench` makes it")
    with ExitStack() as running:

        def start(name: str, **options: object) -> PeerProcess:
            process = running.enter_context(PeerProcess(name, options))
            benchmark.extra_info["configuration"] = process.configuration
            return process

        yield start
