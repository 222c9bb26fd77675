"""One random stream per (seed, stage, trial), independent of the number of workers."""

from zlib import crc32

import numpy as np


def drawn_stream(
    seed: int,
    stage: str,
    *trial: int,
    draw: int = 0,
) -> np.random.Generator:
    """Return the :func:`stream` of the ``draw``; the run's own random numbers are the draw 0."""
    if draw == 0:
        return stream(seed, stage, *trial)
    return stream(seed, stage, draw, *trial)


def stream(seed: int, stage: str, *trial: int) -> np.random.Generator:
    """Return the generator of one trial of one stage, the same on every machine."""
    # the CRC-32 of the name is the same in every process, unlike its hash
    seeds = np.random.SeedSequence(seed, spawn_key=(crc32(stage.encode()), *trial))
    return np.random.Generator(np.random.PCG64(seeds))
