"""Compiled draws give the numbers of NumPy's own, bit for bit, and leave its generator where they
do.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numba import njit

from pipeline.randommatrix.variates import gamma_law, standard_gamma
from pipeline.randommatrix.words import close, opened, uniform, words_of
from pipeline.randommatrix.ziggurat import TAIL, standard_exponential, standard_normal

DRAWS = 300_000  # of which the tail of the normal law is met some eighty times


@cache
def filling(draw: Callable) -> Callable:
    """Fills an array with what ``draw`` makes of the words (4,), one number after the other."""

    @njit
    def fill(out: np.ndarray, words: np.ndarray) -> None:
        state = opened(words)
        for i in range(len(out)):
            out[i], state = draw(state)
        close(words, state)

    return fill


def gamma(shape: float) -> Callable:
    """How a gamma variate of the ``shape`` is drawn."""
    law = gamma_law(shape)
    return njit(lambda state: standard_gamma(law, state))


def drawn(draw: Callable, rng: np.random.Generator) -> np.ndarray:
    """(DRAWS,) numbers."""
    numbers = np.empty(DRAWS)
    filling(draw)(numbers, words_of(rng))
    return numbers


@pytest.mark.parametrize(
    ("draw", "name"),
    [
        (standard_normal, "standard_normal"),
        (standard_exponential, "standard_exponential"),
        (uniform, "random"),
    ],
)
def test_numbers_are_those_of_numpy_and_so_is_the_generator_after_them(draw, name):
    ours, known = np.random.default_rng(3), np.random.default_rng(3)
    np.testing.assert_array_equal(drawn(draw, ours), getattr(known, name)(DRAWS))
    assert ours.bit_generator.state == known.bit_generator.state


def test_the_tail_of_the_normal_law_is_met():
    assert (np.abs(drawn(standard_normal, np.random.default_rng(3))) > TAIL).sum() > 30


@pytest.mark.parametrize("shape", [0.3, 0.999, 1.0, 1.4, 7.0, 50.5])
def test_gamma_variates_are_those_of_numpy(shape):
    ours, known = np.random.default_rng(4), np.random.default_rng(4)
    numbers = drawn(gamma(shape), ours)
    np.testing.assert_array_equal(numbers, known.standard_gamma(shape, DRAWS))
    assert ours.bit_generator.state == known.bit_generator.state


def test_what_is_drawn_in_python_and_in_compiled_code_takes_turns():
    ours, known = np.random.default_rng(5), np.random.default_rng(5)
    for _ in range(3):
        np.testing.assert_array_equal(drawn(standard_normal, ours), known.standard_normal(DRAWS))
        assert ours.random() == known.random()


def test_words_hold_the_generator_that_they_are_of():
    words = words_of(np.random.default_rng(5))
    gc.collect()
    held = np.empty(DRAWS)
    filling(uniform)(held, words)
    np.testing.assert_array_equal(held, np.random.default_rng(5).random(DRAWS))
    assert isinstance(words.base.owner, np.random.PCG64)


@pytest.mark.parametrize("kind", [np.random.MT19937, np.random.SFC64, np.random.PCG64DXSM])
def test_another_generator_is_refused(kind):
    with pytest.raises(TypeError, match=rf"not from {kind.__name__}; make the generator by"):
        words_of(np.random.Generator(kind(1)))


def test_a_state_kept_otherwise_is_refused(monkeypatch):
    rng = np.random.default_rng(6)
    monkeypatch.setattr(np, "frombuffer", lambda *_: np.zeros(4, np.uint64))
    with pytest.raises(RuntimeError, match="does not keep PCG64 as four words"):
        words_of(rng)
