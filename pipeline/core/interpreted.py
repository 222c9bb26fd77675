"""Stand-in for :mod:`pipeline.core.compiled` without numba, as in an exported model: decorated
functions stay Python functions, which run on arrays of poses.
"""

from collections.abc import Callable

import numpy as np
from numpy import ndarray


def compiled(function: Callable) -> Callable:
    """Return ``function``."""
    return function


inner = inlined = compiled
choose = np.where


def lanes(count: int) -> tuple[ndarray]:
    """Return all indices of ``count`` poses in one array, for loops that visit them at once."""
    return (np.arange(count),)
