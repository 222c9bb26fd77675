"""spatial: what the closed forms say about a spatial arm, from its description and one motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import MISSING, OmegaConf

from pipeline.arm.model import chain_of
from pipeline.cases.verdict import read_claims
from pipeline.core import config, contracts
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from pipeline.core.typed_yaml import load_yaml, typed
from pipeline.studies import page
from pipeline.studies.published import published
from pipeline.studies.spatial.spreads import (
    Parameters,
    covariance,
    joint_rows,
    orders,
    spread_rows,
    straight,
)
from pipeline.studies.spatial.words import TITLE, sections

HERE, OUT = Path(__file__).parent, page.DATA / "spatial"
REFERENCE = 1.0  # m, the characteristic length of a task that nobody gave one


@dataclass
class Way:
    """The ends of a motion, rad (m of prismatic joints)."""

    start: list[float] = MISSING
    end: list[float] = MISSING


@dataclass
class Options:
    """``ways`` by the arms' names in ``pipeline/conf/dataset``."""

    places: int = MISSING  # poses along a motion
    lengths: list[float] = MISSING  # m, growing
    bound: float = MISSING  # of the Gaussian model, over the greatest norm of J⁺
    ways: dict[str, Way] = field(default_factory=dict)

    def __post_init__(self) -> None:
        lengths = list(self.lengths)
        if REFERENCE not in lengths or len(lengths) < 2 or np.any(np.diff(lengths) <= 0):
            raise ConfigError(
                f"lengths must grow, and hold {REFERENCE:g} m and another", key="lengths"
            )
        if not self.bound > 1:
            raise ConfigError("the bound must be above every norm: more than 1", key="bound")


def run() -> None:
    """Work out the spread of every reading on each arm's motion, and write the page."""
    settings = config.sections("spatial", HERE / "dvc.yaml")
    options = config.study_options(HERE, Options)
    trial = partial(
        tables_of, options=options, sigma_b=published(read_claims()).sigma_b, conf=config.CONF
    )
    parts = list(
        run_trials(trial, list(options.ways), compute=settings.compute, label="spatial: arms")
    )
    tables = {
        name: pd.concat([part[name] for part in parts], ignore_index=True) for name in parts[0]
    }
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("spatial", {}, settings.compute)
    page.write_page("spatial", TITLE, sections(**tables))


def tables_of(arm: str, options: Options, sigma_b: float, conf: Path) -> dict[str, pd.DataFrame]:
    """The study's tables of one ``arm``; ``conf`` is the folder of the options.

    Raises ConfigError where the ends of its motion are not poses of it, and SingularJacobianError.
    """
    section = load_yaml(conf / f"dataset/{arm}.yaml").robot
    robot, way = OmegaConf.to_object(typed(Robot, section, "robot")), options.ways[arm]
    for key in ("start", "end"):
        if len(getattr(way, key)) != len(robot.joints):
            raise ConfigError(
                f"must hold {len(robot.joints)} values, one a joint", key=f"ways.{arm}.{key}"
            )

    def motion(length: float):
        chain = chain_of(replace(robot, length=length))
        return straight(chain, way.start, way.end, options.places)

    reference = motion(REFERENCE)
    parameters = Parameters(sigma_b, 1.0, options.bound).calibrated(reference)
    # whether a pivot is small hangs on no length
    usable = [
        lu
        for lu in orders(len(reference.chain.task))
        if np.isfinite(covariance(reference, lu, parameters)).all()
    ]
    curves = [
        spread_rows(motion(length), usable, parameters).assign(length=length)
        for length in options.lengths
    ]
    return {
        "spatial": pd.concat(curves, ignore_index=True).assign(arm=arm),
        "spatial_joints": joint_rows(reference, robot.joints, parameters).assign(arm=arm),
    }
