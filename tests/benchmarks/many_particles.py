"""A filter of very many particles: what one costs, beside a filter of few."""

from __future__ import annotations

import time

import numpy as np
from cost_growth import cost, in_a_process
from scenario import take

FEW, STEPS, ROUNDS = 10_000, 40, 3


def seconds(particles: tuple[int, ...], rounds: int = ROUNDS) -> dict[int, float]:
    """Processor time in s of a particle and step by number of particles, the shortest of the
    rounds, in each of which every number has its turn.
    """
    motion, best = take(STEPS), dict.fromkeys(particles, np.inf)
    motion.filtered(FEW, np.random.default_rng(0))
    for number in range(rounds):
        for count in particles:
            rng = np.random.default_rng(number)
            begin = time.process_time()
            motion.filtered(count, rng)
            best[count] = min(best[count], (time.process_time() - begin) / (count * STEPS))
    return best


def memory(particles: int) -> float:
    """Bytes of a filter at their peak beyond what the process had before."""
    _, megabytes = in_a_process(cost, "particles", particles, None)
    return 1e6 * megabytes


def run(particles: int) -> dict[str, object]:
    """``particles`` beside few: time of a particle and step in s, and bytes of a particle, which
    are the slope from a tenth of them on.
    """
    times = seconds((FEW, particles))
    few, many = particles // 10, particles
    least, most = memory(few), memory(many)
    return {
        "few": FEW,
        "many": particles,
        "steps": STEPS,
        "seconds_few": times[FEW],
        "seconds_many": times[particles],
        "peak_bytes": most,
        "bytes_of_a_particle": (most - least) / (many - few),
    }
