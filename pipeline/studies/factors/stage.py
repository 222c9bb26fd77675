"""factors: which readings of "LU or QR" the paper's published parameters allow, over random paths
of its arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from omegaconf import MISSING, OmegaConf

from pipeline.arm.chain import TASK, PlanarChain
from pipeline.arm.model import arm_of
from pipeline.cases.verdict import read_claims
from pipeline.core import config, contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from pipeline.core.typed_yaml import load_yaml, typed
from pipeline.models.gaussian.law import noise_scale
from pipeline.studies import page
from pipeline.studies.factors.paths import draw_paths, quadrature, with_tool
from pipeline.studies.factors.readings import all_readings, crossings, wishart_spread
from pipeline.studies.factors.shares import Spreads, joined, path_table, share_table
from pipeline.studies.factors.words import TITLE, sections
from pipeline.studies.published import Published, published

HERE, OUT = Path(__file__).parent, page.DATA / "factors"
YOUBOT = config.CONF / "dataset/youbot.yaml"  # the paper's arm, whatever dataset is analysed


@dataclass
class Options:
    """What paths are drawn, and when a statement of the paper passes for true."""

    chunks: int = MISSING  # random streams, each with one length of the tool, in turn
    candidates: int = MISSING  # paths drawn a chunk
    nodes: int = MISSING  # of the quadrature along a path, both ends among them
    tools: list[float] = MISSING  # m
    rests: list[float] = MISSING  # shares of the steps at rest
    dividing_norm: float = MISSING  # 1/m and 1 mixed
    dividing_travel: float = MISSING  # rad
    overspeed: float = MISSING  # share of the speed limit
    alike: float = MISSING  # factor

    def __post_init__(self) -> None:
        if not all(0 <= rest < 1 for rest in self.rests):
            raise ConfigError("shares of rest must be from 0 to below 1", key="rests")
        if self.chunks < len(self.tools):
            raise ConfigError("every length of the tool needs a chunk", key="chunks")


def run() -> None:
    """Draw the paths, hold every reading against the published numbers, and write the page."""
    settings = config.sections("factors", HERE / "dvc.yaml")
    options, compute = config.study_options(HERE, Options), settings.compute
    arm, rate = paper_arm()
    stated = published(read_claims())
    trial = partial(
        spreads_of_chunk,
        chain=arm,
        rate=rate,
        stated=stated,
        options=options,
        seed=settings.seed,
    )
    chunks = run_trials(trial, range(options.chunks), compute=compute, label="factors: paths")
    spreads = joined(list(chunks))
    names = reading_columns(len(TASK), len(arm.lengths))
    tables = {
        "factors": share_table(
            spreads,
            names,
            stated,
            options.alike,
            options.rests,
            options.overspeed,
            subsets(spreads, options),
        ),
        "factor_paths": path_table(
            spreads,
            stated,
            options.rests,
            options.overspeed,
            options.chunks * options.candidates,
        ),
    }
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("factors", {"alike": options.alike}, compute)
    thresholds = {"overspeed": options.overspeed, "alike": options.alike}
    page.write_page("factors", TITLE, sections(**tables, published=stated, **thresholds))


def spreads_of_chunk(
    chunk: int, chain: PlanarChain, rate: float, stated: Published, options: Options, seed: int
) -> Spreads:
    """Both models on the paths of one ``chunk``.

    Args:
        chunk: its number.
        chain: the arm.
        rate: steps a second.
        stated: the published parameters.
        options: of the study.
        seed: of the experiment.
    """
    tool = options.tools[chunk % len(options.tools)]
    chain, stream = with_tool(chain, tool), rng.stream(seed, "factors", chunk)
    places, weights = quadrature(options.nodes)
    paths = draw_paths(chain, rate, stated.u, options.candidates, places, stream)
    jacobian = chain.jacobian(paths.q)
    v = np.matvec(jacobian, paths.step[:, None])
    m, n = jacobian.shape[-2:]
    variance = noise_scale(paths.norm, stated.alpha, stated.u, n, m) * np.vecdot(v, v)
    crossed = crossings(jacobian)
    wishart = [
        wishart_spread(reading, jacobian, v, weights, stated.sigma_b, crossed)
        for reading in all_readings(m, n)
    ]
    return Spreads(
        np.full(len(v), tool),
        paths.norm.max(axis=1, initial=0.0),
        np.abs(paths.q[:, -1] - paths.q[:, 0]).max(axis=1, initial=0.0),
        np.sqrt(variance @ weights),
        np.stack(wishart),
    )


def subsets(spreads: Spreads, options: Options) -> dict[str, np.ndarray]:
    """Masks (P,) of the paths that are counted apart, by name."""
    masks = {f"tool of {tool:g} m": spreads.tool == tool for tool in options.tools}
    for name, values, limit, unit in (
        ("greatest norm", spreads.norm, options.dividing_norm, ""),
        ("travel", spreads.travel, options.dividing_travel, " rad"),
    ):
        masks[f"{name} up to {limit:g}{unit}"] = values <= limit
        masks[f"{name} above {limit:g}{unit}"] = values > limit
    return masks


def paper_arm() -> tuple[PlanarChain, float]:
    """The chain of the paper's arm, and its steps a second."""
    youbot = load_yaml(YOUBOT)
    robot = OmegaConf.to_object(typed(Robot, youbot.robot, "robot"))
    return arm_of(robot).chain, float(youbot.motion.rate)


def reading_columns(m: int, n: int) -> dict[str, list[str]]:
    """The columns that name the readings of a task of ``m`` rows and ``n`` joints."""
    readings = all_readings(m, n)
    return {
        "factorisation": [reading.name for reading in readings],
        "rows": [
            " ".join(TASK[i] for i in reading.rows).replace("phi", "φ") for reading in readings
        ],
        "joints": ["-".join(str(j + 1) for j in reading.joints) for reading in readings],
    }
