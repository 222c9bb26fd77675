"""The takes of a fleet of arms through noise, fit and filter, in memory that does not grow with
their number.

Takes come, are kept and are read in blocks, a table of each block in a folder of its own. The fit
goes twice over the blocks: sums over the takes of the process noise and of its products give what
the estimators of the whole take from their means and covariances; the squares of σ̂_Bk, which are
means over takes, add up to those of all. The filter writes a block's posterior before the next.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from cost_growth import megabytes
from scenario import DT, FRAME_EVERY, PLANAR, SENSOR, SIGMA_B, START, swing, youbot

from pipeline.core import contracts, rng
from pipeline.core.columns import spread, values
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start
from pipeline.models.commands import open_loop
from pipeline.models.draws import draw_steps
from pipeline.models.noise import process_noise
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.dispersion import step_dispersions
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.perturbation import objective_weights
from pipeline.stages.filter import filter_take

BLOCK = 100  # takes that are in memory at once
REST, MOVING = 20, 100  # steps
POSE = 2e-4  # rad, standard deviation of a measured pose
FLOOR = 0.2  # ε of B⁻¹ ⪰ εI, as the option file of the model has it
SEED = 2017
JOINTS = ("arm_joint_2", "arm_joint_3", "arm_joint_4")
LU = Decomposition(PLANAR["youbot"])
SEEN = np.arange(FRAME_EVERY, REST + MOVING + 1, FRAME_EVERY)  # steps with a measurement


@dataclass(frozen=True)
class Fitted:
    """What the fit makes of all takes."""

    sigma_b: float
    noise_covariance: np.ndarray  # (n, n) rad², Σ_ω of the additive model
    start: Start
    bias: np.ndarray  # (n,) rad, of what the filter measures
    sensor: np.ndarray  # (n, n) rad², its covariance


class Sums:
    """Of samples that come in blocks, (N, ..., n) each, over N: enough for mean and covariance."""

    def __init__(self) -> None:
        self.count, self.total, self.products = 0, 0.0, 0.0

    def add(self, samples: np.ndarray) -> None:
        """Take a block in."""
        self.count += len(samples)
        self.total += samples.sum(axis=0)
        self.products += np.einsum("t...i,t...j->...ij", samples, samples)

    @property
    def mean(self) -> np.ndarray:
        """(..., n)."""
        return self.total / self.count

    @property
    def covariance(self) -> np.ndarray:
        """(..., n, n), which divides by the samples less one."""
        square = self.mean[..., :, None] * self.mean[..., None, :]
        return (self.products - self.count * square) / (self.count - 1)


@cache
def commands() -> np.ndarray:
    """(M, 3) steps that every arm of the fleet is commanded: a rest, then a swing."""
    path = swing(MOVING)
    moving = np.matvec(youbot().jacobian(path[:-1]), np.diff(path, axis=0))
    return np.vstack([np.zeros((REST, 3)), moving])


def blocks(takes: int) -> Iterator[range]:
    """The numbers of the takes, block by block."""
    return (range(first, min(first + BLOCK, takes)) for first in range(0, takes, BLOCK))


def place(folder: Path, block: range) -> Path:
    """The folder of a block's tables."""
    return folder / f"{block.start:08d}"


def record(folder: Path, takes: int) -> None:
    """Draw every take from the Wishart model, and write what is measured of it: the joints at every
    step, and readings as coarse as the depth camera's at some.
    """
    chain, truth = youbot(), WishartModel(SIGMA_B, LU)
    grid, root = np.arange(REST + MOVING + 1), np.sqrt(SENSOR)
    for block in blocks(takes):
        stream = rng.stream(SEED, "fleet.record", block.start)
        q = np.empty((len(block), len(grid), 3))
        deviation = stream.standard_normal((len(block), 3))
        q[:, 0] = START.mean + deviation @ np.linalg.cholesky(START.covariance).T
        for k, v in enumerate(commands()):
            # at rest nothing is perturbed
            q[:, k + 1] = draw_steps(truth, chain, q[:, k], v, stream)[0] if v.any() else q[:, k]
        seen = q[:, SEEN] + stream.standard_normal((len(block), len(SEEN), 3)) @ root
        q += POSE * stream.standard_normal(q.shape)
        joints = {"k": np.tile(grid, len(block)), "residual": 0.0} | spread("q", JOINTS, q)
        _write(joints, "joints", folder, block, grid * DT)
        _write(spread("q", JOINTS, seen), "encoders", folder, block, SEEN * DT)


def _write(
    table: dict[str, object], name: str, folder: Path, block: range, times: np.ndarray
) -> None:
    takes = np.repeat([f"take_{number:08d}" for number in block], len(times))
    about = {"take": takes, "part": "training", "t": np.tile(times, len(block))}
    here = place(folder, block)
    here.mkdir(parents=True, exist_ok=True)
    contracts.write(pd.DataFrame(about | table), name, here)


def _read(name: str, folder: Path, block: range) -> np.ndarray:
    """(takes, rows, 3) rad, the joint angles of one of a block's tables."""
    return values(contracts.read(name, place(folder, block)), "q").reshape(len(block), -1, 3)


def fit(folder: Path, takes: int) -> Fitted:
    """The paper's estimates of both motion models, and the law of the readings."""
    chain, v = youbot(), commands()
    noise, start, off, squares = Sums(), Sums(), Sums(), 0.0
    for block in blocks(takes):
        q, seen = (_read(name, folder, block) for name in ("joints", "encoders"))
        noise.add(process_noise(chain, q, v))
        start.add(q[:, 0])
        off.add((seen - q[:, SEEN]).reshape(-1, 3))
    still = np.trace(noise.products[:REST], axis1=1, axis2=2).mean() / takes
    weights = objective_weights(np.sqrt(still), len(chain.task))
    for block in blocks(takes):
        q = _read("joints", folder, block)
        dispersions, _ = step_dispersions(
            chain, q[:, :-1], v, process_noise(chain, q, v), LU, weights, FLOOR
        )
        squares += len(block) * dispersions**2
    return Fitted(
        float(np.sqrt(squares / takes).mean()),
        noise.covariance.mean(axis=0),
        Start(start.mean, start.covariance),
        off.mean,
        off.covariance,
    )


def filtered(folder: Path, takes: int, particles: int, fitted: Fitted) -> dict[str, float]:
    """Write the posterior of every take; root mean squares in rad of what its mean and what the
    takes' own is off the measured poses.
    """
    model, off, alone = WishartModel(fitted.sigma_b, LU), Sums(), Sums()
    options, steps = FilterOptions(particles), open_loop(commands())
    for block in blocks(takes):
        q, seen = (_read(name, folder, block) for name in ("joints", "encoders"))
        tables = []
        for number, y in zip(block, seen, strict=True):
            bias, law = (np.tile(each, (len(y), 1, 1)) for each in (fitted.bias, fitted.sensor))
            take = Measurements(f"take_{number:08d}", SEEN * DT, y, bias[:, 0], law)
            posterior, _, _ = filter_take(
                (number, take),
                model,
                youbot(),
                JOINTS,
                steps,
                1 / DT,
                fitted.start,
                options,
                (SEED, "fleet.filter"),
            )
            tables.append(posterior)
        together = pd.concat(tables, ignore_index=True)
        contracts.write(together, "posterior", place(folder, block))
        off.add(values(together, "m").reshape(q.shape) - q)
        alone.add(q)
    means = {"filter": np.trace(off.products, axis1=1, axis2=2) / off.count}
    means["mean"] = np.trace(alone.covariance, axis1=1, axis2=2)
    return {f"off_the_{name}_rad": float(np.sqrt(each.mean() / 3)) for name, each in means.items()}


def run(folder: Path, takes: int, particles: int) -> dict[str, object]:
    """All of it in this process: processor time of each part in s, memory of the process at its
    peak and what is kept, both in bytes.
    """
    seconds: dict[str, float] = {}

    def timed(name: str, function: Callable, *arguments: object) -> object:
        begin = time.process_time()
        result = function(folder, takes, *arguments)
        seconds[name] = time.process_time() - begin
        return result

    timed("record", record)
    fitted = timed("fit", fit)
    errors = timed("filter", filtered, particles, fitted)
    kept = [*folder.rglob("*")]
    return {
        "takes": takes,
        "particles": particles,
        "steps": REST + MOVING,
        "seconds": seconds,
        "peak_bytes": 1e6 * megabytes("VmHWM"),
        "kept_bytes": sum(file.stat().st_size for file in kept if file.is_file()),
        "kept_files": len(kept),
        "sigma_b": fitted.sigma_b,
        "true_sigma_b": SIGMA_B,
    } | errors
