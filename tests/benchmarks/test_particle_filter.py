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

EXACT = "Particle filter, Wishart model: peers given the exact law of a step"
PAPER = "Particle filter, Wishart model: peers given the paper's Algorithm 1"
BOTH_CORES = "Particle filter, Wishart model: takes on two threads"
LIBRARIES = ("particles", "filterpy", "pfilter", "stonesoup")


@pytest.fixture
def problem(size) -> tuple[Take, int]:
    """A take and how many particles filter it."""
    return take(size(30, 12)), size(10_000, 500)


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
    assert apart(np.array(benchmark(filtered)), our_posterior(problem)) < 0.2


def test_without_the_frames_the_means_would_be_others():
    problem = take(60), 2000
    assert apart(our_posterior(problem, seed=2).mean, our_posterior(problem)) < 0.2
    assert apart(our_posterior((problem[0].unseen(), 2000)).mean, our_posterior(problem)) > 0.5


@pytest.mark.parametrize("group", [EXACT, PAPER])
def test_ours(benchmark, problem, group):
    benchmark.group = group
    benchmark.extra_info |= {"role": "ours", "items": items(problem)}
    posterior = benchmark(partial(our_posterior, problem))
    assert posterior.resampled.any() and posterior.measured.sum() == len(problem[0].measurements.t)


@pytest.mark.benchmark(group=EXACT)
@pytest.mark.parametrize("library", LIBRARIES)
def test_peer_by_the_exact_law(benchmark, peer, problem, library):
    benchmark.extra_info |= {"role": "peer", "items": items(problem), "target": 6}
    contested(benchmark, peer, problem, library, "closed form")


@pytest.mark.benchmark(group=PAPER)
@pytest.mark.parametrize("library", LIBRARIES)
def test_peer_by_algorithm_1(benchmark, peer, problem, library):
    benchmark.extra_info |= {"role": "peer", "items": items(problem), "target": 50}
    contested(benchmark, peer, problem, library, "Algorithm 1")


@pytest.mark.benchmark(group=PAPER)
def test_particles_with_algorithm_1_written_out_by_hand(benchmark, peer, problem):
    # no target: a user who knows Bartlett's decomposition and eliminates all Jacobians at once
    benchmark.extra_info |= {"role": "peer", "items": items(problem)}
    contested(benchmark, peer, problem, "particles", "Algorithm 1 by hand")


@pytest.mark.benchmark(group=EXACT)
def test_floor_of_the_numbers_that_the_law_draws(benchmark, problem):
    benchmark.extra_info |= {"role": "floor", "items": items(problem), "target": 2}
    benchmark(PARTS["numbers"](*problem, np.random.default_rng(1)))


@pytest.mark.benchmark(group=EXACT)
def test_floor_of_sines_cosines_and_roots(benchmark, problem):
    benchmark.extra_info |= {"role": "floor", "items": items(problem)}
    benchmark(PARTS["circular functions"](*problem, np.random.default_rng(1)))


# what else the machine does comes and goes in seconds: measured for longer than the other contests
@pytest.mark.benchmark(group=BOTH_CORES, max_time=10)
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
