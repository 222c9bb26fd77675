"""Depth images for tests."""

from __future__ import annotations

import numpy as np

SHAPE = (424, 512)


def frame(seed: int = 1, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    generator = np.random.default_rng(seed)
    raw = (
        1800
        + 0.5 * np.arange(shape[1])
        + 0.3 * np.arange(shape[0])[:, None]
        + generator.normal(size=shape) * 5
    )
    raw[generator.random(shape) < 0.2] = 0
    return raw.astype(np.uint16)
