"""Where the time of a particle and step goes: the random numbers, the arithmetic, the weights and
moments, resampling, each measured alone.
"""

from __future__ import annotations

import numpy as np
import pytest
from filter_parts import PARTS
from scenario import take

ARMS = {"youbot": "youBot, 3 joints", "ur5": "UR5, 6 joints", "lwr4": "LWR4+, 7 joints"}


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("arm", ARMS)
def test_part(benchmark, size, arm, part):
    motion, particles = take(size(30, 12), arm), size(10_000, 500)
    benchmark.group = f"Parts of the filter: {ARMS[arm]}"
    items = particles * len(motion.steps)
    benchmark.extra_info |= {"role": "part", "items": items, "arm": ARMS[arm], "part": part}
    benchmark(PARTS[part](motion, particles, np.random.default_rng(1)))


@pytest.mark.parametrize("arm", ARMS)
def test_the_numbers_alone_are_those_that_the_moves_draw(arm):
    after = []
    for part, steps in (("numbers", 6), ("moves", 6), ("numbers", 7)):
        rng = np.random.default_rng(1)
        PARTS[part](take(steps, arm), 500, rng)()
        after.append(rng.random())
    assert after[0] == after[1] != after[2]
