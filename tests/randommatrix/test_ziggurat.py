"""Compiled draws give the numbers of NumPy's own, bit for bit, and leave its generator where they
do.
"""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python

from pipeline.core.compiled import inner
from pipeline.randommatrix.variates import gamma_law, standard_gamma
from pipeline.randommatrix.words import close, opened, uniform, words_of
from pipeline.randommatrix.ziggurat import TAIL, standard_exponential, standard_normal

DRAWS = 300_000  # of which the tail of the normal law is met some eighty times


@inner
def normals(out: np.ndarray, words: np.ndarray) -> None:
    state = opened(words)
    for i in range(len(out)):
        out[i], state = standard_normal(state)
    close(words, state)


@inner
def exponentials(out: np.ndarray, words: np.ndarray) -> None:
    state = opened(words)
    for i in range(len(out)):
        out[i], state = standard_exponential(state)
    close(words, state)


@inner
def uniforms(out: np.ndarray, words: np.ndarray) -> None:
    state = opened(words)
    for i in range(len(out)):
        out[i], state = uniform(state)
    close(words, state)


@inner
def gammas(out: np.ndarray, words: np.ndarray, law: tuple) -> None:
    state = opened(words)
    for i in range(len(out)):
        out[i], state = standard_gamma(law, state)
    close(words, state)


def drawn(fill, rng: np.random.Generator, *law) -> np.ndarray:
    """(DRAWS,) numbers."""
    numbers = np.empty(DRAWS)
    from_python(fill)(numbers, words_of(rng), *law)
    return numbers


@pytest.mark.parametrize(
    ("fill", "name"),
    [(normals, "standard_normal"), (exponentials, "standard_exponential"), (uniforms, "random")],
)
def test_numbers_are_those_of_numpy_and_so_is_the_generator_after_them(fill, name):
    ours, known = np.random.default_rng(3), np.random.default_rng(3)
    np.testing.assert_array_equal(drawn(fill, ours), getattr(known, name)(DRAWS))
    assert ours.bit_generator.state == known.bit_generator.state


def test_the_tail_of_the_normal_law_is_met():
    assert (np.abs(drawn(normals, np.random.default_rng(3))) > TAIL).sum() > 30


@pytest.mark.parametrize("shape", [0.3, 0.999, 1.0, 1.4, 7.0, 50.5])
def test_gamma_variates_are_those_of_numpy(shape):
    ours, known = np.random.default_rng(4), np.random.default_rng(4)
    numbers = drawn(gammas, ours, gamma_law(shape))
    np.testing.assert_array_equal(numbers, known.standard_gamma(shape, DRAWS))
    assert ours.bit_generator.state == known.bit_generator.state


def test_what_is_drawn_in_python_and_in_compiled_code_takes_turns():
    ours, known = np.random.default_rng(5), np.random.default_rng(5)
    for _ in range(3):
        np.testing.assert_array_equal(drawn(normals, ours), known.standard_normal(DRAWS))
        assert ours.random() == known.random()


@pytest.mark.parametrize("kind", [np.random.MT19937, np.random.SFC64, np.random.PCG64DXSM])
def test_another_generator_is_refused(kind):
    with pytest.raises(TypeError, match=rf"not from {kind.__name__}; make the generator by"):
        words_of(np.random.Generator(kind(1)))


def test_a_state_kept_otherwise_is_refused(monkeypatch):
    rng = np.random.default_rng(6)
    monkeypatch.setattr(np, "frombuffer", lambda *_: np.zeros(4, np.uint64))
    with pytest.raises(RuntimeError, match="does not keep PCG64 as four words"):
        words_of(rng)
