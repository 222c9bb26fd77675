"""One random stream per (seed, stage, trial), so that results do not depend on the number of
workers.
"""

from zlib import crc32

import numpy as np


def stream(seed: int, stage: str, *trial: int) -> np.random.Generator:
    """Generator for one trial of one stage; equal arguments give equal numbers on every machine and
    worker.

    The stage's name enters by its CRC-32, which unlike ``hash`` is the same in every process.
    """
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(crc32(stage.encode()), *trial)))
    )
