"""Contests with a peer, which runs in a process of its own interpreter; sizes for measuring or for
trying.

A contest is one group of pytest-benchmark, named by a sentence. Each of its tests states in
``benchmark.extra_info`` its ``role`` ("ours" or "peer"), the ``items`` that one call treats and,
where its result has a quality, its ``error`` or ``objective`` (less is better); a peer also its
``configuration`` and the ``target``, the least ratio of its time an item to ours.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import PIPE, Popen

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

# last, so that tests/conftest.py stays what other tests find by that name
sys.path += [str(Path(__file__).parent), str(Path(__file__).parent / "peers")]
from contests import HERE, INTERPRETER

# settings of our own arithmetic for the sake of equal bytes, from which a peer is free
OURS = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES")


@pytest.fixture
def size(benchmark: BenchmarkFixture) -> Callable[[int, int], int]:
    """Return ``size(measured, tried)``: the size of a problem for `make bench`, or for `make test`,
    which runs ours once, unmeasured (--benchmark-disable in pyproject.toml).
    """
    return lambda measured, tried: tried if benchmark.disabled else measured


@pytest.fixture
def peer(benchmark: BenchmarkFixture) -> Iterator[Callable[..., Callable[[], object]]]:
    """Return ``peer(NAME, **options)``, which starts peers/serve.py with peers/NAME.py, a line of
    JSON in each direction a call, and returns what calls it.
    """
    if benchmark.disabled:
        pytest.skip("importing the peers takes seconds each; `make bench` runs them")
    if not INTERPRETER.exists():
        pytest.skip("the peers' environment is missing; `make bench` makes it")
    environment = {key: value for key, value in os.environ.items() if key not in OURS}
    running = []

    def start(name: str, **options: object) -> Callable[[], object]:
        command = [INTERPRETER, HERE / "peers/serve.py", name]
        process = Popen(command, env=environment, stdin=PIPE, stdout=PIPE, text=True)
        running.append(process)

        def ask(line: str = "") -> object:
            print(line, file=process.stdin, flush=True)
            if not (answer := process.stdout.readline()):
                raise RuntimeError(f"the peer {name} ended, with its traceback above")
            return json.loads(answer)

        options_line = json.dumps(options, default=lambda array: array.tolist())
        benchmark.extra_info["configuration"] = ask(options_line)
        return ask

    yield start
    for process in running:
        process.kill()
        process.communicate()
