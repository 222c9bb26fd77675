"""Comparison of the bytes of results on processors of other levels and on other numbers of
threads, as reports/benchmarks/equal_bytes.json: ``python tests/benchmarks/equal_bytes.py FOLDER``.

Each setting is a process of its own, ``python equal_bytes.py ANSWER THREADS`` in a copy of the
project in which everything is compiled anew for its level. The last is a control: an arithmetic
that the project excludes, by which some bytes have to differ.
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

# before numpy: it fixes the arithmetic
from contests import (
    LEVELS,
    machine,
    write_results,
)

if "CORETYPE" in os.environ:  # of the control
    os.environ["OPENBLAS_CORETYPE"] = os.environ["CORETYPE"]

import numpy as np  # isort: skip
from omegaconf import OmegaConf
from project_copy import copy_project
from scenario import Take, drawn_takes, scene, take

from pipeline.configuration.config import CONF
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kinds import estimate, options_type
from pipeline.models.steps import Recorded, process_noise
from pipeline.statistics.densities import kernel_density, normal_reference_bandwidth

TAKES = 12
STEPS = 60
REST = 15
# seeds, spread over the threads; particles of each
FILTERED = 4
PARTICLES = 2000
NEEDED = {"x86-64-v4": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}}
# name → level, number of threads, environment
SETTINGS = {}
for level, environment in LEVELS.items():
    SETTINGS[f"{level}, 1 thread"] = level, 1, environment
    SETTINGS[f"{level}, 2 threads"] = level, 2, environment
CONTROL = "control"
OTHER = {"CORETYPE": "Sandybridge"}


def filtered(motion: Take, threads: int) -> list[np.ndarray]:
    """Posteriors of a take from several seeds."""
    with ThreadPoolExecutor(threads) as pool:
        seeds = map(np.random.default_rng, range(FILTERED))
        posteriors = list(pool.map(lambda rng: motion.filtered(PARTICLES, rng), seeds))
    arrays = []
    for posterior in posteriors:
        arrays += [posterior.mean, posterior.covariance]
    return arrays


def recorded_takes() -> Recorded:
    """Takes that a Gaussian model draws of the youBot, measured with noise."""
    stage = scene("youbot")._replace(model=GaussianModel(0.05, 25.0))
    rng = np.random.default_rng(7)
    q, v = drawn_takes(stage, TAKES, STEPS, 1e-4, rng, REST)
    noise = process_noise(stage.chain, q, v)
    return Recorded(stage.chain, q[:, :-1], v, noise, ("a", "b", "c"), rate=100.0)


def pieces(threads: int) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Name and arrays of each piece: fit and filter of every option file, other arms, a density."""
    youbot = take(30)
    data = recorded_takes()
    for file in sorted((CONF / "model").glob("*.yaml")):
        options = OmegaConf.to_container(OmegaConf.load(file), resolve=True)
        fit = estimate(data, options_type(options["kind"])(**options))
        steps = data.chain, data.q, data.v, data.q_next
        likelihood = fit.model.log_density(*steps, data.measurement).mean()
        numbers = [*fit.estimates.values(), likelihood]
        yield f"fit, {file.stem}", [np.array(numbers)]
        fitted = replace(youbot, scene=youbot.scene._replace(model=fit.model))
        yield f"filter, {file.stem}", filtered(fitted, threads)
    for arm in ("ur5", "lwr4"):
        yield f"filter, {arm}", filtered(take(30, arm), threads)
    rng = np.random.default_rng(28)
    samples = rng.standard_normal((100_000, 2)) @ [[2.0, -1.0], [0.0, 1.0]]
    grid = np.linspace(-6.0, 6.0, 128)
    bandwidth = normal_reference_bandwidth(samples)
    yield "density", [kernel_density(samples, grid, grid, bandwidth)]


def write_hashes(answer: Path, threads: int) -> None:
    """Write the SHA-256 of each piece's bytes."""
    hashes = {}
    for name, arrays in pieces(threads):
        content = b"".join(array.tobytes() for array in arrays)
        hashes[name] = hashlib.sha256(content).hexdigest()
    answer.write_text(json.dumps(hashes))


def hashes_under(
    level: str,
    threads: int,
    environment: dict[str, str],
    folder: Path,
) -> dict[str, str]:
    """Hash of each piece under a setting, in the copy of its level below ``folder``."""
    project = folder / level
    if not project.exists():
        copy_project(project)
        for compiled in [*project.rglob("__pycache__")]:
            shutil.rmtree(compiled)
    answer = project / "hashes.json"
    program = project / "tests/benchmarks/equal_bytes.py"
    setting = os.environ | {"NUMBA_NUM_THREADS": str(threads)} | environment
    command = [sys.executable, program, answer, str(threads)]
    subprocess.run(command, cwd=project, env=setting, check=True)
    return json.loads(answer.read_text())


def main(folder: Path) -> None:
    """Compute under every setting that this processor can run, and write."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    processor = Path("/proc/cpuinfo").read_text()
    flags = {*re.search(r"flags\s*: (.+)", processor)[1].split()}
    skipped = []
    hashes = {}
    for name, setting in SETTINGS.items():
        if NEEDED.get(setting[0], set()) <= flags:
            hashes[name] = hashes_under(*setting, folder)
        else:
            skipped.append(name)
    hashes[CONTROL] = hashes_under("host", 1, OTHER, folder)
    measured = {"machine": machine(), "skipped": skipped, "hashes": hashes}
    write_results("equal_bytes", measured)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        write_hashes(Path(sys.argv[1]), int(sys.argv[2]))
    else:
        main(Path(sys.argv[1]).resolve())
