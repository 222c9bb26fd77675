"""The compiled filter against its plain NumPy form on the same stream: every kind of model, every
scheme.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from compiled_calls import chosen_by, from_python
from oracles import READINGS
from plain_filter import PLAIN_SCHEMES, plain_filter

from pipeline.arm.chain import PlanarChain
from pipeline.arm.planar import BLOCK
from pipeline.core.errors import DegenerateFilterError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import (
    FilterOptions,
    Posterior,
    particle_filter,
)
from pipeline.filtering.resampling import SCHEMES
from pipeline.filtering.sampling import keep_inside
from pipeline.filtering.start import Start, domain_of
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import Commands, open_loop
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.law import WishartModel

DT = 0.01
COVARIANCE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MODELS = {
    "additive": ScaledModel(COVARIANCE),
    "scaled": ScaledModel(COVARIANCE, np.diag([0.04, 0.05, 0.06]) + 0.01),
    **{f"wishart {name}": WishartModel(0.25, each) for name, each in READINGS.items()},
    "wishart pivoted_lu, wide": WishartModel(1.2, READINGS["pivoted_lu"]),
    "gaussian": GaussianModel(0.05, 15.5),
}
PATH_START, PARTICLES = np.array([1.1, -1.6, 1.8]), 3 * BLOCK + 77


@pytest.fixture(scope="module")
def arm() -> PlanarChain:
    """Links askew and senses mixed, the limits so near that some particles leave them."""
    links = np.array([[0.01, 0.155], [-0.02, 0.135], [0.03, 0.17]])
    below, above = np.array([0.2, 0.35, 0.3]), np.array([0.27, 0.3, 0.4])
    return PlanarChain(
        np.array([0.05, -0.1]),
        links,
        np.array([1.0, -1.0, 1.0]),
        PATH_START - below,
        PATH_START + above,
        np.ones(3),
    )


def scene(arm: PlanarChain, steps: int = 60) -> tuple[np.ndarray, Start, Measurements]:
    """Commands that rest, move and rest; a start and measurements about the path, of which some lie
    within steps and some outside.
    """
    rng = np.random.default_rng(3)
    progress = np.clip((np.arange(steps + 1) - 5) / (steps - 10), 0, 1)
    path = PATH_START + 0.25 * np.sin(np.pi * progress)[:, None] ** 2 * np.array([1.0, -0.8, 0.6])
    v = np.matvec(arm.jacobian(path[:-1]), np.diff(path, axis=0))
    t = np.arange(-0.02, DT * steps + 0.04, 1 / 30)
    root = 0.02 * (np.eye(3) + 0.3 * rng.standard_normal((len(t), 3, 3)))
    bias = 0.01 * rng.standard_normal((len(t), 3))
    y = np.stack([np.interp(t, DT * np.arange(steps + 1), path[:, j]) for j in range(3)], axis=1)
    y = y + bias + np.matvec(root, rng.standard_normal((len(t), 3)))
    start = Start(
        PATH_START, 1e-4 * np.array([[20.0, 3.0, 0.0], [3.0, 30.0, -5.0], [0.0, -5.0, 20.0]])
    )
    return v, start, Measurements("test01", t, y, bias, root @ np.swapaxes(root, 1, 2))


def greatest_difference(one: Posterior, other: Posterior) -> float:
    """Over all fields; of the counts and logarithms in shares of them; infinite where a decision or
    a count differs.
    """
    greatest = 0.0
    for field in fields(Posterior):
        a, b = np.asarray(getattr(one, field.name)), np.asarray(getattr(other, field.name))
        if a.dtype.kind == "f":
            greatest = max(
                greatest,
                float(
                    np.max(
                        np.abs(a - b)
                        / (1.0 if field.name in ("mean", "covariance") else np.abs(b) + 1.0)
                    )
                ),
            )
        elif not np.array_equal(a, b):
            return np.inf
    return greatest


def both(
    model, arm, options: FilterOptions, seed: int = 5, share: float = 0.0
) -> tuple[Posterior, Posterior]:
    """In a loop that holds the arm to where the commands without noise lead it."""
    v, start, observed = scene(arm)
    path = arm.pose(start.mean) + np.cumsum(v, axis=0) - v
    commands = Commands(v, path, share)
    streams = [np.random.default_rng(seed) for _ in range(2)]
    compiled = particle_filter(model, arm, commands, DT, start, observed, options, streams[0])
    plain = plain_filter(model, arm, commands, DT, start, observed, options, streams[1])
    assert streams[0].bit_generator.state == streams[1].bit_generator.state
    return compiled, plain


@pytest.mark.parametrize("kind", MODELS)
def test_the_compiled_filter_is_the_plain_one_for_every_model(kind, arm):
    compiled, plain = both(MODELS[kind], arm, FilterOptions(PARTICLES))
    assert greatest_difference(compiled, plain) < 1e-12
    # the scene has everything in it
    assert (
        plain.resampled.sum() > 2
        and plain.outside.sum() > 0
        and plain.left_out == 2
        and plain.measured.sum() > 15
    )
    assert (plain.clipped.sum() > 0) == kind.startswith("gaussian")


@pytest.mark.parametrize("kind", MODELS)
def test_in_a_closed_loop_too_and_the_loop_is_seen(kind, arm):
    """Band: ten times that of an open loop, as the poses' own rounding enters the commands."""
    closed, plain = both(MODELS[kind], arm, FilterOptions(PARTICLES), share=0.4)
    assert greatest_difference(closed, plain) < 1e-11
    opened, _ = both(MODELS[kind], arm, FilterOptions(PARTICLES))
    assert greatest_difference(closed, opened) > 1e-3


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("threshold", [0.3, 0.9])
def test_the_compiled_filter_is_the_plain_one_for_every_scheme(scheme, threshold, arm):
    compiled, plain = both(
        MODELS["wishart pivoted_lu"], arm, FilterOptions(PARTICLES, scheme, threshold)
    )
    assert greatest_difference(compiled, plain) < 1e-12
    assert plain.resampled.any() == (scheme != "none")


@pytest.mark.parametrize("particles", [1, 2, BLOCK - 1, BLOCK, BLOCK + 1])
def test_blocks_of_any_filling_are_filtered(particles, arm):
    roomy = replace(arm, lower=arm.lower - 2.0, upper=arm.upper + 2.0)
    compiled, plain = both(MODELS["wishart pivoted_lu"], roomy, FilterOptions(particles))
    assert greatest_difference(compiled, plain) < 1e-12


def test_a_deviation_of_a_billionth_or_another_resampling_would_be_seen(arm):
    compiled, plain = both(MODELS["additive"], arm, FilterOptions(PARTICLES))
    off, _ = both(ScaledModel((1 + 1e-9) * COVARIANCE), arm, FilterOptions(PARTICLES))
    assert greatest_difference(off, plain) > 1e-12 > greatest_difference(compiled, plain)
    other, _ = both(MODELS["additive"], arm, FilterOptions(PARTICLES, threshold=0.6))
    assert greatest_difference(other, plain) == np.inf


def test_both_lose_all_weight_at_the_same_step(arm):
    v, start, observed = scene(arm)
    narrow = replace(arm, upper=np.array([PATH_START[0] + 0.15, *arm.upper[1:]]))
    failed = []
    for run in (particle_filter, plain_filter):
        with pytest.raises(DegenerateFilterError) as caught:
            run(
                MODELS["gaussian"],
                narrow,
                open_loop(v),
                DT,
                replace(start, covariance=np.zeros((3, 3))),
                observed,
                FilterOptions(300),
                np.random.default_rng(1),
            )
        failed.append(caught.value.evidence["step"])
    assert failed[0] == failed[1] > 5  # the motion rests until then


@pytest.mark.parametrize("scheme", PLAIN_SCHEMES)
@pytest.mark.parametrize("equal", [1, 40, 200])
def test_every_compiled_scheme_chooses_what_the_plain_one_does(scheme, equal):
    for seed in range(50):
        weights = np.random.default_rng(seed).dirichlet(np.full(200, 0.3))
        weights[:equal] = weights[:equal].mean()
        one, other = np.random.default_rng(seed), np.random.default_rng(seed)
        assert np.array_equal(
            chosen_by(scheme, weights, one), PLAIN_SCHEMES[scheme](weights, other)
        )
        assert one.bit_generator.state == other.bit_generator.state


@pytest.mark.parametrize("signs", [[1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, -1.0]])
def test_particles_outside_the_chains_domain_lose_their_weight_and_go_back(signs, arm):
    chain = replace(arm, signs=np.array(signs), lower=np.full(3, -8.0), upper=np.full(3, 8.0))
    rng = np.random.default_rng(9)
    q = rng.uniform(-9, 9, (4000, 3))
    # three thousand poses about a straight elbow
    straight = chain.signs[1] * np.arctan2(
        np.linalg.det(chain.links[:2]), chain.links[0] @ chain.links[1]
    )
    q[:3000, 1] = straight + np.pi * rng.integers(-2, 3, 3000) + rng.uniform(-3e-3, 3e-3, 3000)
    gone = ~chain.within_limits(q) | chain.singular(q)
    assert 900 < np.sum(chain.singular(q[:3000])) < 1100
    here, there, log_weights = np.zeros((3, 4000)), np.ascontiguousarray(q.T), np.zeros(4000)
    log_weights[:100] = -np.inf
    assert from_python(keep_inside)(
        domain_of(chain), here, there, log_weights, np.empty(4000)
    ) == np.sum(gone[100:])
    assert np.array_equal(there.T, np.where(gone[:, None], 0.0, q))
    assert np.array_equal(log_weights == -np.inf, gone | (np.arange(4000) < 100))
