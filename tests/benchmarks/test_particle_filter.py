"""The particle filter of one take under the Wishart model, against libraries that a user would take
for it: the youBot's planar arm by LU with partial pivoting, UR5 and LWR4+ by QR of Jᵀ.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numba
import numpy as np
import pytest
from scenario import Take, apart, scene, take

from pipeline.filtering.particle_filter import Posterior
from pipeline.models.draws import draw_steps
from pipeline.models.scaled.law import ScaledModel

ARMS = {
    "youbot": "Particle filter, Wishart model by pivoted LU: youBot, three joints in a plane",
    "ur5": "Particle filter, Wishart model by QR of Jᵀ: UR5, six joints",
    "lwr4": "Particle filter, Wishart model by QR of Jᵀ: LWR4+, seven joints",
}
TARGETS = {"youbot": 8, "ur5": 5, "lwr4": 5}  # times as fast as every library
PAPER = "Particle filter, Wishart model: peers given the paper's Algorithm 1"
THREADS = "Particle filter, Wishart model: takes on two threads"
PLAIN = "Steps of the additive model, youBot: against a loop over single poses"
LIBRARIES = ("particles", "stonesoup")
# standard deviations that posterior means of so many particles differ by, at most
NEAR = 0.3


@pytest.fixture(params=ARMS)
def problem(benchmark, request, size) -> tuple[str, Take, int]:
    """Name of an arm, a take of it and the number of particles."""
    benchmark.group = ARMS[request.param]
    return request.param, take(size(30, 6), request.param), size(10_000, 500)


def posterior_of(motion: Take, particles: int, seed: int = 1) -> Posterior:
    return motion.filtered(particles, np.random.default_rng(seed))


def state(benchmark, motion: Take, particles: int, **extra: object) -> None:
    """State that a call treats so many particles moved by so many steps."""
    benchmark.extra_info |= {"items": particles * len(motion.steps), **extra}


def contested(benchmark, peer, motion: Take, particles: int, library: str, law: str) -> None:
    """Measure ``library``, and check that its posterior means are ours."""
    run = peer(f"{library}_wishart", count=particles, law=law, **motion.told())
    means = benchmark(run)
    assert apart(np.array(means), posterior_of(motion, particles)) < NEAR


def test_ours(benchmark, problem):
    _, motion, particles = problem
    state(benchmark, motion, particles, role="ours")
    posterior_of(motion, particles)  # loads compiled code
    posterior = benchmark(posterior_of, motion, particles)
    assert posterior.resampled.any() and posterior.measured.sum() == len(motion.measurements.t)


@pytest.mark.parametrize("library", LIBRARIES)
def test_peer(benchmark, peer, problem, library):
    arm, motion, particles = problem
    state(benchmark, motion, particles, role="peer", target=TARGETS[arm], against=library)
    contested(benchmark, peer, motion, particles, library, "closed form")


@pytest.mark.benchmark(group=PAPER)
def test_ours_of_the_paper(benchmark, size):
    motion, particles = take(size(30, 12)), size(10_000, 500)
    state(benchmark, motion, particles, role="ours")
    posterior_of(motion, particles)
    benchmark(posterior_of, motion, particles)


# a call takes seconds
@pytest.mark.benchmark(group=PAPER, min_rounds=2)
def test_particles_by_algorithm_1(benchmark, peer, size):
    motion, particles = take(size(30, 12)), size(10_000, 500)
    state(benchmark, motion, particles, role="peer", target=75, against="particles")
    contested(benchmark, peer, motion, particles, "particles", "Algorithm 1")


# measured for longer than other contests, as other processes come and go in seconds
@pytest.mark.benchmark(group=THREADS, max_time=5)
@pytest.mark.parametrize("threads", [2, 1])
def test_threads(benchmark, size, threads):
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("a single core")
    motion, particles, takes = take(size(30, 12)), size(10_000, 500), 16
    role = {"role": "ours"} if threads == 2 else {"role": "peer", "target": 1.8}
    state(benchmark, motion, takes * particles, against="one thread", **role)
    one = partial(posterior_of, motion, particles)
    with ThreadPoolExecutor(threads) as pool:
        posteriors = benchmark(lambda: list(pool.map(one, range(takes))))
    for seed, posterior in enumerate(posteriors):
        assert np.array_equal(posterior.mean, one(seed).mean)


@numba.njit
def plain_steps(links, signs, q, v, root, rng):
    """(P, 3) draws of q + J⁻¹v + Lε, L = ``root``."""
    moved, jacobian, point, epsilon = q.copy(), np.ones((3, 3)), np.empty((4, 2)), np.empty(3)
    for i in range(len(q)):
        for k in range(3):
            epsilon[k] = rng.standard_normal()
        heading = 0.0
        point[0] = 0.0
        for j in range(3):
            heading += signs[j] * q[i, j]
            sine, cosine = math.sin(heading), math.cos(heading)
            point[j + 1, 0] = point[j, 0] + cosine * links[j, 0] + sine * links[j, 1]
            point[j + 1, 1] = point[j, 1] + cosine * links[j, 1] - sine * links[j, 0]
        for j in range(3):
            jacobian[0, j] = signs[j] * (point[3, 1] - point[j, 1])
            jacobian[1, j] = -signs[j] * (point[3, 0] - point[j, 0])
            jacobian[2, j] = signs[j]
        moved[i] += np.linalg.solve(jacobian, v) + root @ epsilon
    return moved


@pytest.fixture
def steps(size):
    """Guard of the vectorised loops: the same steps from the same stream, one pose at a time."""
    chain, start = scene("youbot").chain, scene("youbot").start
    q = start.mean + 0.05 * np.random.default_rng(1).standard_normal((size(200_000, 600), 3))
    return ScaledModel(1e-6 * np.eye(3)), chain, q, np.array([2e-3, -1e-3, 3e-3])


@pytest.mark.benchmark(group=PLAIN)
def test_ours_of_steps(benchmark, steps):
    benchmark.extra_info |= {"role": "ours", "items": len(steps[2])}
    benchmark(lambda: draw_steps(*steps, np.random.default_rng(1)))


@pytest.mark.benchmark(group=PLAIN)
def test_a_loop_over_single_poses(benchmark, steps):
    model, chain, q, v = steps
    benchmark.extra_info |= {"role": "peer", "items": len(q), "target": 1.5, "against": "a loop"}
    benchmark.extra_info["configuration"] = (
        "numba, one pose after the other: NumPy's inverse of J and its generator, "
        f"numba {numba.__version__}"
    )
    root = np.linalg.cholesky(model.floor)
    arguments = (chain.links, chain.signs, q, v, root)
    moved = benchmark(lambda: plain_steps(*arguments, np.random.default_rng(1)))
    np.testing.assert_allclose(moved, draw_steps(*steps, np.random.default_rng(1))[0], atol=1e-12)


def test_without_the_frames_the_means_would_be_others():
    motion = take(60)
    known = posterior_of(motion, 2000)
    assert apart(posterior_of(motion, 2000, seed=2).mean, known) < NEAR
    assert apart(posterior_of(motion.unseen(), 2000).mean, known) > 0.5
