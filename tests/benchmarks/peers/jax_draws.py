"""One step of many particles by the law that the peers on JAX are given."""

from __future__ import annotations

import jax
import numpy as np
from laws_in_jax import law_of

CONFIGURATION = "no contest"


def setup(count, **told):
    move = jax.jit(jax.vmap(law_of(**told), (0, None, None)))
    keys = jax.random.split(jax.random.key(1), count)

    def call() -> list:
        """(P, n) particles after the third step, from the start."""
        moved = move(keys, np.array(told["start_mean"]), np.array(told["steps"][2]))
        return np.asarray(moved).tolist()

    return call
