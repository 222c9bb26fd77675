"""Hashes of the bytes of the pipeline's results: ``python result_bytes.py ANSWER THREADS``
in a copy of the project, takes filtered on so many threads, trials run by so many processes.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import pipeline.core.environment  # noqa: F401 - before numpy: it fixes the arithmetic

import numpy as np  # isort: skip
from omegaconf import OmegaConf
from scenario import Scene, Take, scene, swing, take

from pipeline.core.config import CONF
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kinds import estimate, options_type
from pipeline.models.noise import process_noise
from pipeline.models.steps import Recorded, mean_log_likelihood
from pipeline.statistics.densities import kernel_density, normal_reference_bandwidth

TAKES, STEPS, REST = 12, 60, 15
FILTERED, PARTICLES = 4, 2000  # takes on all threads; of each
SAMPLES, POINTS = 100_000, 128


def recorded() -> Recorded:
    """Takes of the youBot's planar arm, at rest in the first steps."""
    stage, rng = scene("youbot"), np.random.default_rng(7)
    path = swing(STEPS, stage.start.mean)
    path[:REST] = path[REST]
    v = np.matvec(stage.chain.jacobian(path[:-1]), np.diff(path, axis=0))
    q = np.empty((TAKES, STEPS + 1, 3))
    q[:, 0] = path[0]
    for k in range(STEPS):
        moved, _ = draw_steps(GaussianModel(0.05, 25.0), stage.chain, q[:, k], v[k], rng)
        q[:, k + 1] = moved + 1e-4 * rng.standard_normal((TAKES, 3))
    return Recorded(stage.chain, q[:, :-1], v, process_noise(stage.chain, q, v), ("a", "b", "c"))


def fits(data: Recorded) -> Iterator[tuple[str, object, list[np.ndarray]]]:
    """Name of every option file, the fitted model and its numbers."""
    for file in sorted((CONF / "model").glob("*.yaml")):
        options = OmegaConf.to_container(OmegaConf.load(file), resolve=True)
        fit = estimate(data, options_type(options["kind"])(**options))
        likelihood = mean_log_likelihood(data, fit.model)
        yield file.stem, fit.model, [np.array([*fit.estimates.values(), likelihood])]


def filtered(motion: Take, threads: int) -> list[np.ndarray]:
    """Posteriors of the same take from several seeds."""
    with ThreadPoolExecutor(threads) as pool:
        seeds = map(np.random.default_rng, range(FILTERED))
        posteriors = list(pool.map(partial(motion.filtered, PARTICLES), seeds))
    return [part for one in posteriors for part in (one.mean, one.covariance)]


def pieces(threads: int) -> Iterator[tuple[str, list[np.ndarray]]]:
    """The name of each piece, and all its numbers."""
    youbot, planar = take(30, "youbot"), scene("youbot")
    for name, model, numbers in fits(recorded()):
        yield f"fit, {name}", numbers
        seen = Scene(planar.chain, model, planar.start, planar.sensor, planar.every)
        motion = Take(seen, youbot.steps, youbot.measurements)
        yield f"filter, {name}", filtered(motion, threads)
    for arm in ("ur5", "lwr4"):
        yield f"filter, {arm}", filtered(take(30, arm), threads)
    samples = np.random.default_rng(28).standard_normal((SAMPLES, 2)) @ [[2.0, -1.0], [0.0, 1.0]]
    grid = np.linspace(-6.0, 6.0, POINTS)
    yield "density", [kernel_density(samples, grid, grid, normal_reference_bandwidth(samples))]


def digest(numbers: list[np.ndarray]) -> str:
    """SHA-256 of their bytes, one array after the other."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in numbers)).hexdigest()


def main(answer: Path, threads: int) -> None:
    """Compute all and write."""
    answer.write_text(json.dumps({name: digest(numbers) for name, numbers in pieces(threads)}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
