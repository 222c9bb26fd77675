"""The particle filter of one take under the Wishart model, against the libraries that a user would
take for it.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from filter_parts import PARTS
from scenario import Take, apart, take

from pipeline.filtering.particle_filter import Posterior

EXACT = {
    "youbot": "Particle filter, Wishart model: peers given the exact law of a step",
}
PAPER = "Particle filter, Wishart model: peers given the paper's Algorithm 1"
BOTH_CORES = "Particle filter, Wishart model: takes on two threads"
LIBRARIES = ("particles", "filterpy", "pfilter", "stonesoup")
FLOORS = {
    "numbers": {
        "against": "floor of the numbers that the law draws",
        "target": 2,
        "configuration": "the random numbers that all steps need, drawn by the filter's own "
        "compiled draws, block by block into the same scratch, and nothing else: a filter of this "
        "law can take no less without other draws",
    },
    "circular functions": {
        "against": "floor of sines cosines and roots",
        "configuration": "the sines and cosines of all joints and the square roots of a step, by "
        "the filter's own compiled functions, and nothing else",
    },
}


@pytest.fixture
def problem(size) -> tuple[Take, int]:
    """A take and how many particles filter it, by the LU of the peers' libraries."""
    return take(size(30, 12), "youbot"), size(10_000, 500)


@pytest.fixture(params=EXACT)
def exact(benchmark, request, size) -> tuple[Take, int]:
    """The same for the exact law."""
    benchmark.group = EXACT[request.param]
    return take(size(30, 12), request.param), size(10_000, 500)


def our_posterior(problem: tuple[Take, int], seed: int = 1) -> Posterior:
    motion, particles = problem
    return motion.filtered(particles, np.random.default_rng(seed))


def items(problem: tuple[Take, int]) -> int:
    """A particle moved by a step is what a filter treats."""
    motion, particles = problem
    return particles * len(motion.steps)


def contested(benchmark, peer, problem: tuple[Take, int], library: str, law: str) -> None:
    """Measure ``library`` on the problem, and see that it solved that one: its posterior means are
    ours.
    """
    motion, particles = problem
    filtered = peer(f"{library}_wishart", count=particles, law=law, **motion.told())
    means = benchmark(filtered)
    assert apart(np.array(means), our_posterior(problem)) < 0.2


def test_without_the_frames_the_means_would_be_others():
    problem = take(60), 2000
    assert apart(our_posterior(problem, seed=2).mean, our_posterior(problem)) < 0.2
    assert apart(our_posterior((problem[0].unseen(), 2000)).mean, our_posterior(problem)) > 0.5


def ours(benchmark, problem: tuple[Take, int]) -> None:
    benchmark.extra_info |= {"role": "ours", "items": items(problem)}
    our_posterior(problem)  # loads what is compiled, so that the first call is like the others
    posterior = benchmark(our_posterior, problem)
    assert posterior.resampled.any() and posterior.measured.sum() == len(problem[0].measurements.t)


def test_ours_by_the_exact_law(benchmark, exact):
    ours(benchmark, exact)


@pytest.mark.benchmark(group=PAPER)
def test_ours(benchmark, problem):
    ours(benchmark, problem)


@pytest.mark.parametrize("library", [*LIBRARIES, "cuthbert"])
def test_peer_by_the_exact_law(benchmark, peer, exact, library):
    role = {"role": "peer", "against": library, "target": 12}
    benchmark.extra_info |= {**role, "items": items(exact)}
    contested(benchmark, peer, exact, library, "closed form")


# a call takes seconds
@pytest.mark.benchmark(group=PAPER, min_rounds=2)
@pytest.mark.parametrize("library", LIBRARIES)
def test_peer_by_algorithm_1(benchmark, peer, problem, library):
    benchmark.extra_info |= {"role": "peer", "items": items(problem), "target": 150}
    contested(benchmark, peer, problem, library, "Algorithm 1")


@pytest.mark.benchmark(group=PAPER)
def test_particles_with_algorithm_1_written_out_by_hand(benchmark, peer, problem):
    # no target: a user who knows Bartlett's decomposition and eliminates all Jacobians at once
    benchmark.extra_info |= {"role": "peer", "items": items(problem)}
    contested(benchmark, peer, problem, "particles", "Algorithm 1 by hand")


@pytest.mark.parametrize("part", FLOORS)
def test_floor(benchmark, exact, part):
    benchmark.extra_info |= {"role": "floor", "items": items(exact), **FLOORS[part]}
    benchmark(PARTS[part](*exact, np.random.default_rng(1)))


# what else the machine does comes and goes in seconds: measured for longer than the other contests
@pytest.mark.benchmark(group=BOTH_CORES, max_time=5)
@pytest.mark.parametrize(
    "threads", [pytest.param(2, id="two threads"), pytest.param(1, id="one thread")]
)
def test_threads(benchmark, problem, threads):
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("one core alone")
    role = {"role": "ours"} if threads == 2 else {"role": "peer", "target": 1.8}
    takes = 16
    benchmark.extra_info |= role | {"items": takes * items(problem)}
    with ThreadPoolExecutor(threads) as pool:
        posteriors = benchmark(
            lambda: list(pool.map(partial(our_posterior, problem), range(takes)))
        )
    # neither the thread nor its neighbours can be told from the result
    assert all(
        np.array_equal(posterior.mean, our_posterior(problem, seed).mean)
        for seed, posterior in enumerate(posteriors)
    )
