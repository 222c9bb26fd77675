"""Random numbers of compiled code: NumPy's own, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import DRAW
from planned_arms import path_problem

from pipeline.models import draws
from pipeline.models.draws import numbers_for
from pipeline.models.law import Numbers
from pipeline.models.model import Law
from pipeline.randommatrix.words import words_of

PARTICLES = 20_000


def test_what_a_command_of_the_task_alone_leaves_out_is_zero_whatever_the_memory_held(monkeypatch):
    monkeypatch.setattr(draws, "aligned", lambda rows, size: np.full((rows, size), np.nan))
    held = numbers_for(Law(None, np.empty(0), normals=(1, 3)), path_problem("planar", 1).chain)
    assert held.command.shape[0] == 5
    assert not held.command.any()


def drawn(chain, rng: np.random.Generator, count: int = PARTICLES, **wanted: object) -> Numbers:
    numbers = numbers_for(Law(None, np.empty(0), **wanted), chain, PARTICLES)
    DRAW(numbers, count, words_of(rng))
    return numbers


@pytest.mark.parametrize("degrees", [0.02, 0.3, 1.0, 1.9999, 2.0, 2.0001, 3.7, 62.0, 1e6])
def test_chi_squares_are_numpys_and_come_before_the_normals(degrees, chain):
    one, other = np.random.default_rng(7), np.random.default_rng(7)
    numbers = drawn(chain, one, normals=(1, 2), degrees=(degrees, 5.0))
    for number, each in zip(numbers.chi_square, (degrees, 5.0), strict=True):
        assert np.array_equal(number, other.chisquare(each, PARTICLES))
    assert np.array_equal(numbers.normal, other.standard_normal((PARTICLES, 2)).T)
    assert one.random() == other.random()


@pytest.mark.parametrize("sets", [1, 2])
def test_normals_are_numpys_set_by_set_and_particle_by_particle(sets, chain):
    one, other = np.random.default_rng(8), np.random.default_rng(8)
    numbers = drawn(chain, one, normals=(sets, 7))
    assert np.array_equal(
        numbers.normal,
        np.concatenate([other.standard_normal((PARTICLES, 7)).T for _ in range(sets)]),
    )
    assert one.random() == other.random()


def test_a_block_that_is_not_full_takes_no_more_numbers_than_it_has_particles(chain):
    one, other = np.random.default_rng(9), np.random.default_rng(9)
    numbers = drawn(chain, one, count=3, normals=(1, 2), degrees=(5.0,))
    assert np.array_equal(numbers.chi_square[0, :3], other.chisquare(5.0, 3))
    assert np.array_equal(numbers.normal[:, :3], other.standard_normal((3, 2)).T)
    assert one.random() == other.random()


def test_every_row_of_a_block_starts_with_a_line_of_the_cache(chain):
    numbers = numbers_for(Law(None, np.empty(0), normals=(1, 2), degrees=(5.0,)), chain)
    for rows in (numbers.chi_square, numbers.normal, numbers.command):
        assert [row.ctypes.data % 64 for row in rows] == [0] * len(rows) and rows.flags.c_contiguous
