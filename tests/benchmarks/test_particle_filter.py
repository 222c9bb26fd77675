"""The particle filter of one take under the Wishart model, against libraries that a user would take
for it: the youBot's planar arm by LU with partial pivoting, UR5 and LWR4+ by QR of Jᵀ.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from scenario import Take, distance, take

from pipeline.filtering.particle_filter import Posterior


class Contest(NamedTuple):
    """Arm, law of the peers, and times as fast as every library."""

    arm: str
    law: str
    target: float


CONTESTS = {
    "Particle filter, Wishart model by pivoted LU: youBot, three joints in a plane": (
        Contest("youbot", "closed form", 8)
    ),
    "Particle filter, Wishart model by QR of Jᵀ: UR5, six joints": (
        Contest("ur5", "closed form", 5)
    ),
    "Particle filter, Wishart model by QR of Jᵀ: LWR4+, seven joints": (
        Contest("lwr4", "closed form", 5)
    ),
    "Particle filter, Wishart model: peers given the paper's Algorithm 1": (
        Contest("youbot", "Algorithm 1", 75)
    ),
}
THREADS = "Particle filter, Wishart model: takes on two threads"
# standard deviations that posterior means of so few particles differ by, at most
NEAR = 0.4


@pytest.fixture(params=CONTESTS)
def contest(benchmark, request) -> Contest:
    benchmark.group = request.param
    return CONTESTS[request.param]


@pytest.fixture
def problem(benchmark, contest, size) -> tuple[Take, int]:
    """A take of the contest's arm and the number of particles."""
    motion = take(size(320, 6), contest.arm)
    particles = size(1000, 500)
    benchmark.extra_info["items"] = particles * len(motion.steps)
    return motion, particles


def posterior_of(motion: Take, particles: int, seed: int = 1) -> Posterior:
    return motion.filtered(particles, np.random.default_rng(seed))


def test_ours(benchmark, problem):
    benchmark.extra_info["role"] = "ours"
    posterior_of(*problem)  # loads compiled code

    posterior = benchmark(posterior_of, *problem)

    motion, _ = problem
    assert posterior.resampled.any()
    assert posterior.measured.sum() == len(motion.measurements.t)


@pytest.mark.parametrize("library", ["particles", "stonesoup"])
def test_peer(benchmark, peer, contest, problem, library):
    """Its posterior means are ours of ten times as many particles."""
    if contest.law == "Algorithm 1" and library != "particles":
        pytest.skip("one library is enough: the law takes nearly all of the time")
    motion, particles = problem
    benchmark.extra_info |= {"role": "peer", "target": contest.target}
    benchmark.extra_info["against"] = library
    options = {"count": particles, "law": contest.law}
    run = peer(f"{library}_wishart", **options, **motion.plain())

    means = np.array(benchmark(run))

    assert distance(means, posterior_of(motion, 10 * particles)) < NEAR


# measured for longer than other contests, as other processes come and go in seconds
@pytest.mark.benchmark(group=THREADS, max_time=5)
@pytest.mark.parametrize("threads", [2, 1])
def test_threads(benchmark, size, threads):
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("a single core")
    motion = take(size(320, 12))
    particles = size(1000, 500)
    takes = 16
    benchmark.extra_info["items"] = takes * particles * len(motion.steps)
    if threads == 2:
        benchmark.extra_info["role"] = "ours"
    else:
        stated = {"role": "peer", "target": 1.8, "against": "one thread"}
        benchmark.extra_info |= stated
    filtered = partial(posterior_of, motion, particles)

    with ThreadPoolExecutor(threads) as pool:
        posteriors = benchmark(lambda: list(pool.map(filtered, range(takes))))

    for seed, posterior in enumerate(posteriors):
        assert np.array_equal(posterior.mean, filtered(seed).mean)


def test_means_are_near_under_another_seed_and_far_without_the_motion():
    motion = take(60)
    posterior = posterior_of(motion, 2000)
    another_seed = posterior_of(motion, 2000, seed=2)
    assert distance(another_seed.mean, posterior) < NEAR

    resting = Take(motion.scene, 0 * motion.steps, motion.measurements)
    assert distance(posterior_of(resting, 2000).mean, posterior) > 0.5
