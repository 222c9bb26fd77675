"""The particle filter of an arm in space, six task rows, against a loop over Pinocchio and the
libraries that a user would take for it, all with the exact law of a step.
"""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest
from pinocchio_loop import PinocchioTake, filtered
from scenario import SPATIAL, Take, apart, robot, take

from pipeline.filtering.particle_filter import Posterior

ARMS = {
    "ur5": "Particle filter, Wishart model by QR of Jᵀ: UR5, six joints",
    "lwr4": "Particle filter, Wishart model by QR of Jᵀ: LWR4+, seven joints",
}
LIMITS = {"ur5": 0.7e-6, "lwr4": 0.9e-6}  # s a particle and step
PARTICLES = 10_000
# standard deviations: what the means of so many particles may be off, twice what they were
NEAR = 0.3
LIBRARIES = ("particles", "filterpy", "pfilter", "stonesoup", "cuthbert")


@pytest.fixture(params=SPATIAL)
def problem(benchmark, request, size) -> tuple[str, Take]:
    """The name of an arm and a take of it."""
    benchmark.group = ARMS[request.param]
    return request.param, take(size(30, 6), request.param)


@cache
def known_means(arm: str) -> Posterior:
    """By ten times as many particles, of the take that is measured."""
    return our_posterior(take(30, arm), 10 * PARTICLES)


def our_posterior(motion: Take, particles: int) -> Posterior:
    return motion.filtered(particles, np.random.default_rng(1))


def told(benchmark, motion: Take, particles: int, **extra: object) -> None:
    """State what one call treats: a particle moved by a step."""
    benchmark.extra_info |= {"items": particles * len(motion.steps), **extra}


def test_ours(benchmark, problem, size):
    arm, motion = problem
    particles = size(PARTICLES, 500)
    told(benchmark, motion, particles, role="ours", limit=LIMITS[arm])
    our_posterior(motion, particles)  # loads what is compiled
    posterior = benchmark(our_posterior, motion, particles)
    assert posterior.resampled.any() and posterior.measured.sum() == len(motion.steps)


def test_pinocchio_in_a_loop(benchmark, problem, size):
    arm, motion = problem
    particles, options = size(500, 200), robot(arm)
    told(benchmark, motion, particles, role="peer", target=50, against="a loop over Pinocchio")
    benchmark.extra_info["configuration"] = (
        "particle by particle in Python, Pinocchio's compiled Jacobian and NumPy's QR; 500 "
        "particles, as its time grows with their number alone"
    )
    loop = PinocchioTake(options.urdf, options.tool, **motion.told())
    means = benchmark(partial(filtered, loop, particles))
    # of the take as long as it is tried or measured
    known = our_posterior(motion, PARTICLES)
    assert apart(means, known) < 3 * NEAR


@pytest.mark.parametrize("library", LIBRARIES)
def test_peer(benchmark, peer, problem, library):
    told(benchmark, problem[1], PARTICLES, role="peer", target=8, against=library)
    contested(benchmark, peer, problem, library, "closed form")


def test_particles_with_the_factors_by_the_library(benchmark, peer, problem):
    # no target: a user who leaves the factors to NumPy, which calls LAPACK once a particle
    told(benchmark, problem[1], PARTICLES, role="peer", against="particles with LAPACK's QR")
    contested(benchmark, peer, problem, "particles", "closed form, LAPACK's QR")


def contested(benchmark, peer, problem: tuple[str, Take], library: str, law: str) -> None:
    """Measure ``library`` on the take, and see that it solved that one: its posterior means are
    ours.
    """
    arm, motion = problem
    run = peer(f"{library}_wishart", count=PARTICLES, law=law, **motion.told())
    means = benchmark(run)
    assert apart(np.array(means), known_means(arm)) < NEAR


def test_without_the_encoders_the_means_would_be_others():
    motion, known = take(30, "lwr4"), known_means("lwr4")
    assert apart(our_posterior(motion, PARTICLES).mean, known) < NEAR
    assert apart(our_posterior(motion.unseen(), PARTICLES).mean, known) > 2 * NEAR
