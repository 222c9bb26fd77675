"""A filter of a million particles, ten thousand takes, and trials on a Dask cluster of which a
worker is killed: ``python tests/benchmarks/scale.py`` writes reports/benchmarks/scale.json.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import time
from functools import partial
from pathlib import Path

from growth import ROOT, cost, in_a_process, megabytes  # first, as it fixes the arithmetic

import numpy as np  # isort: skip
from contests import machine
from distributed import Client, LocalCluster
from scenario import Take, swing, take, youbot

from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Compute, Dask
from pipeline.models.draws import draw_steps
from pipeline.models.noise import process_noise
from pipeline.models.steps import Recorded
from pipeline.models.wishart.fit import Problems
from pipeline.models.wishart.perturbation import objective_weights

STEPS, BLOCK = 40, 100  # of a take; takes in memory at once
PARTICLES = 1000  # of the filter of a take
POSE = 2e-4  # rad, standard deviation of a measured pose
FLOOR = 0.2  # ε of B⁻¹ ⪰ εI
WORKERS = 3


def many_particles(count: int) -> dict[str, float]:
    """Time in s and memory in bytes of a particle (and step) at ``count`` and at a hundredth."""
    few, many = count // 100, count
    seconds, memory = {}, {}
    for size in (few, many):
        runs = [in_a_process(cost, "particles", size) for _ in range(2)]
        seconds[size] = min(each[0] for each in runs) / (size * STEPS)
        memory[size] = 1e6 * min(each[1] for each in runs)
    each = (memory[many] - memory[few]) / (many - few)
    times = {"seconds_few": seconds[few], "seconds_many": seconds[many]}
    return {"few": few, "many": many} | times | {"bytes_of_a_particle": each}


def many_takes(count: int) -> dict[str, float]:
    """Takes drawn, fitted and filtered block by block; processor time in s and peak memory of the
    process in bytes.
    """
    motion, chain, total, begin = take(STEPS), youbot(), 0.0, time.process_time()
    path, model = swing(STEPS), motion.scene.model
    v = np.matvec(chain.jacobian(path[:-1]), np.diff(path, axis=0))
    weights, off = objective_weights(np.sqrt(2) * POSE, 3), []
    for first in range(0, count, BLOCK):
        rng = np.random.default_rng(first)
        q = np.repeat(path[None, :1], min(BLOCK, count - first), axis=0)
        for step in v:
            q = np.concatenate([q, draw_steps(model, chain, q[:, -1:], step[None], rng)[0]], axis=1)
        q += POSE * rng.standard_normal(q.shape)
        recorded = Recorded(chain, q[:, :-1], v, process_noise(chain, q, v), ())
        problems = Problems.of(recorded, model.decomposition, FLOOR)
        total += len(q) * float(problems.solved(weights).squares.mean())
        for number in range(len(q)):
            posterior = motion.filtered(PARTICLES, np.random.default_rng(first + number))
            off.append(float(posterior.ess.min()))
    return {
        "takes": count,
        "seconds": time.process_time() - begin,
        "peak_bytes": 1e6 * megabytes("VmHWM"),
        "sigma_b": float(np.sqrt(total / count)),
    }


def posterior_hash(number: int, motion: Take) -> str:
    """Hash of the posterior of a take under its own stream."""
    posterior = motion.filtered(20 * PARTICLES, np.random.default_rng(number))
    return hashlib.sha256(posterior.mean.tobytes() + posterior.covariance.tobytes()).hexdigest()


def lost_worker(trials: int) -> dict[str, int]:
    """Number of the ``trials`` that have the same bytes in one process and on a cluster of which a
    worker is killed while they run.
    """
    function, label = partial(posterior_hash, motion=take(STEPS)), "posteriors"
    alone = list(run_trials(function, range(trials), compute=Compute(1), label=label))
    with (
        LocalCluster(WORKERS, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        processes = list(client.run(os.getpid).values())
        there = Compute(dask=Dask(address=cluster.scheduler_address))
        results = run_trials(function, range(trials), compute=there, label=label)
        across = [next(results)]
        os.kill(processes[0], signal.SIGKILL)
        across += list(results)
    equal = sum(one == other for one, other in zip(alone, across, strict=True))
    return {"trials": trials, "equal_bytes": equal, "workers": WORKERS}


def main() -> None:
    """Measure and write; the sizes can be smaller, for trying out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--particles", type=int, default=1_000_000)
    parser.add_argument("--takes", type=int, default=10_000)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--out", type=Path, default=ROOT / "reports/benchmarks/scale.json")
    sizes = parser.parse_args()
    many_takes(1)  # loads compiled code, which the processes below inherit
    few, many = (in_a_process(many_takes, count) for count in (sizes.takes // 10, sizes.takes))
    measured = {
        "machine": machine(),
        "particles": many_particles(sizes.particles),
        "takes": {"few": few, "many": many},
        "cluster": lost_worker(sizes.trials),
    }
    sizes.out.write_text(json.dumps(measured, indent=1) + "\n")


if __name__ == "__main__":
    main()
