"""The random words of NumPy's generator PCG64, drawn in compiled code: the very ones that the
library draws, without a call to it for each.

PCG64 is the generator XSL-RR 128/64 of O'Neill (PCG: a family of simple fast space-efficient
statistically good algorithms for random number generation, HMC-CS-2014-0905): its state s of 128
bits goes to a·s + c, c its increment, and the word is its halves' exclusive or, turned by the
highest six bits. Compiled code holds state and increment as four words, low before high: a
``state``, which each draw returns anew, so that it stays in the processor's registers.
"""

from __future__ import annotations

import ctypes

import numpy as np
from llvmlite import ir
from numba import types, uint64
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from pipeline.core.compiled import inlined

FACTOR = 0x2360ED051FC65DA44385DF649FCCF645  # a
WORDS = types.Array(uint64, 1, "C")
STATE = types.UniTuple(uint64, 4)
WORD, DOUBLE_WORD = ir.IntType(64), ir.IntType(128)
UNIT = 2.0**-53  # of a uniform number


def words_of(rng: np.random.Generator) -> np.ndarray:
    """(4,) the state and increment of ``rng`` where the library keeps them: what compiled code
    draws moves ``rng`` on.

    Raises TypeError for another generator than PCG64, that of ``numpy.random.default_rng``, and
    RuntimeError where the library keeps it otherwise.
    """
    generator = rng.bit_generator
    if not isinstance(generator, np.random.PCG64):
        raise TypeError(
            f"compiled draws take numbers from PCG64, not from {type(generator).__name__}; make "
            "the generator by numpy.random.default_rng"
        )
    place = ctypes.c_void_p.from_address(generator.ctypes.state_address).value
    memory = (ctypes.c_uint64 * 4).from_address(place)
    memory.owner = generator  # which frees it when nobody holds it
    words = np.frombuffer(memory, np.uint64)
    known, low = generator.state["state"], 2**64 - 1
    halves = [half for each in (known["state"], known["inc"]) for half in (each & low, each >> 64)]
    if words.tolist() != halves:
        raise RuntimeError(
            f"NumPy {np.__version__} does not keep PCG64 as four words, low before high"
        )
    return words


@inlined
def opened(words: np.ndarray) -> tuple:
    """The state of ``words`` (4,) to draw from; :func:`close` ends it."""
    return words[0], words[1], words[2], words[3]


@inlined
def close(words: np.ndarray, state: tuple) -> None:
    """Leave ``words`` (4,) where the draws have brought the ``state``."""
    words[0], words[1] = state[0], state[1]


@intrinsic
def next_word(typingctx: object, state: object) -> tuple:
    """The next word, and the state after it."""

    def code(context: object, builder: ir.IRBuilder, signature: Signature, given: list) -> object:
        parts = [builder.extract_value(given[0], index) for index in range(4)]
        state, increment = (_wide(builder, *parts[first : first + 2]) for first in (0, 2))
        state = builder.add(builder.mul(state, DOUBLE_WORD(FACTOR)), increment)
        low = builder.trunc(state, WORD)
        high = builder.trunc(builder.lshr(state, DOUBLE_WORD(64)), WORD)
        both = builder.xor(low, high)
        turn = builder.module.declare_intrinsic(
            "llvm.fshr", [WORD], ir.FunctionType(WORD, [WORD] * 3)
        )
        word = builder.call(turn, [both, both, builder.lshr(high, WORD(58))])
        after = context.make_tuple(builder, STATE, [low, high, *parts[2:]])
        return context.make_tuple(builder, signature.return_type, [word, after])

    return types.Tuple((uint64, STATE))(STATE), code


def _wide(builder: ir.IRBuilder, low: object, high: object) -> object:
    """The 128 bits of two words."""
    high = builder.shl(builder.zext(high, DOUBLE_WORD), DOUBLE_WORD(64))
    return builder.or_(builder.zext(low, DOUBLE_WORD), high)


@inlined
def uniform(state: tuple) -> tuple[float, tuple]:
    """One number of ``rng.random()``, and the state after it."""
    word, state = next_word(state)
    return np.int64(word >> np.uint64(11)) * UNIT, state
