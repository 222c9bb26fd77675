"""The particle filter of one take under the Wishart model, against libraries that a user would take
for it: the youBot's planar arm by LU with partial pivoting, UR5 and LWR4+ by QR of Jᵀ.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from scenario import Take, distance, take

from pipeline.filtering.particle_filter import Posterior

CONTESTS = {  # arm, law of the peers, times as fast as every library
    "Particle filter, Wishart model by pivoted LU: youBot, three joints in a plane": (
        "youbot", "closed form", 8),
    "Particle filter, Wishart model by QR of Jᵀ: UR5, six joints": ("ur5", "closed form", 5),
    "Particle filter, Wishart model by QR of Jᵀ: LWR4+, seven joints": ("lwr4", "closed form", 5),
    "Particle filter, Wishart model: peers given the paper's Algorithm 1": (
        "youbot", "Algorithm 1", 75),
}  # fmt: skip
THREADS = "Particle filter, Wishart model: takes on two threads"
# standard deviations that posterior means of so few particles differ by, at most
NEAR = 0.4


@pytest.fixture(params=CONTESTS)
def problem(benchmark, request, size) -> tuple[tuple[str, str, int], Take, int]:
    """Contest, a take of its arm and the number of particles."""
    benchmark.group, contest = request.param, CONTESTS[request.param]
    motion, particles = take(size(320, 6), contest[0]), size(1000, 500)
    benchmark.extra_info["items"] = particles * len(motion.steps)
    return contest, motion, particles


def posterior_of(motion: Take, particles: int, seed: int = 1) -> Posterior:
    return motion.filtered(particles, np.random.default_rng(seed))


def test_ours(benchmark, problem):
    _, motion, particles = problem
    benchmark.extra_info["role"] = "ours"
    posterior_of(motion, particles)  # loads compiled code
    posterior = benchmark(posterior_of, motion, particles)
    assert posterior.resampled.any()
    assert posterior.measured.sum() == len(motion.measurements.t)


@pytest.mark.parametrize("library", ["particles", "stonesoup"])
def test_peer(benchmark, peer, problem, library):
    """Its posterior means are ours of ten times as many particles."""
    (_, law, target), motion, particles = problem
    if law == "Algorithm 1" and library != "particles":
        pytest.skip("one library is enough: the law takes nearly all of the time")
    benchmark.extra_info |= {"role": "peer", "target": target, "against": library}
    run = peer(f"{library}_wishart", count=particles, law=law, **motion.plain())
    means = benchmark(run)
    assert distance(np.array(means), posterior_of(motion, 10 * particles)) < NEAR


# measured for longer than other contests, as other processes come and go in seconds
@pytest.mark.benchmark(group=THREADS, max_time=5)
@pytest.mark.parametrize("threads", [2, 1])
def test_threads(benchmark, size, threads):
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("a single core")
    motion, particles, takes = take(size(320, 12)), size(1000, 500), 16
    role = {"role": "ours"} if threads == 2 else {"role": "peer", "target": 1.8}
    role["items"] = takes * particles * len(motion.steps)
    benchmark.extra_info |= role | {"against": "one thread"}
    filtered = partial(posterior_of, motion, particles)
    with ThreadPoolExecutor(threads) as pool:
        posteriors = benchmark(lambda: list(pool.map(filtered, range(takes))))
    for seed, posterior in enumerate(posteriors):
        assert np.array_equal(posterior.mean, filtered(seed).mean)


def test_means_are_near_under_another_seed_and_far_without_the_motion():
    motion = take(60)
    posterior = posterior_of(motion, 2000)
    assert distance(posterior_of(motion, 2000, seed=2).mean, posterior) < NEAR
    resting = Take(motion.scene, 0 * motion.steps, motion.measurements)
    assert distance(posterior_of(resting, 2000).mean, posterior) > 0.5
