"""principles: by which principles the synthetic laboratory's arm was made, each with the number
that shows whether it is kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import MISSING

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import arm_of, greatest_torques, torques
from pipeline.cases.verdict import read_claims
from pipeline.core import config, contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.options.dataset import Robot
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.studies import page
from pipeline.studies.principles import rows
from pipeline.studies.principles.motion import driven, lasting, moved
from pipeline.studies.principles.paths import candidates, misfit, shares
from pipeline.studies.principles.words import TITLE, sections
from pipeline.studies.published import Published, published

HERE, OUT = Path(__file__).parent, page.DATA / "principles"
LAGS = 30  # steps over which the correlation of the deviation is shown
EVERY = 20  # of the servo's steps at full speed has its torque computed


@dataclass
class Options:
    """How much is drawn."""

    takes: int = MISSING
    draws: int = MISSING  # of paths
    way: float = MISSING  # rad


def run() -> None:
    """Simulate the arm alone, draw the paths it might have taken, and write the page."""
    settings = config.sections("principles", HERE / "dvc.yaml")
    options, dataset = config.study_options(HERE, Options), settings.dataset
    tables = {}
    if dataset.laboratory is None:
        print("principles: the dataset is recorded; there is no laboratory")
    else:
        tables = _tables(dataset.robot, dataset.laboratory, options, settings)
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("principles", {}, settings.compute)
    page.write_page("principles", TITLE, sections(tables.get("principles")))


def _tables(robot: Robot, laboratory: dict, options: Options, settings) -> dict[str, pd.DataFrame]:
    """The study's tables by name."""
    motion, dynamics = laboratory["trajectory"], laboratory["dynamics"]
    stated, chain = published(read_claims()), arm_of(robot).chain
    stream = rng.stream(settings.seed, "principles.takes")
    arm = moved(chain, motion, dynamics, options.takes, stream)
    # the teeth of the gear, and no motor, throw the link about in its play
    held = moved(chain, motion, replace(dynamics, clearance=0.0), options.takes, stream)
    t, states = driven(motion, held, EVERY)
    shape = states.shape[1:]
    needed = torques(robot, *states.reshape(3, -1, shape[-1])).reshape(shape)
    mean, std, greatest = needed.mean(axis=0), needed.std(axis=0), greatest_torques(robot)
    fit = partial(
        _misfit,
        chain=chain,
        motion=motion,
        exponent=dynamics.speed_exponent,
        stated=stated,
    )
    stream = rng.stream(settings.seed, "principles.paths")
    drawn = candidates(chain, options.way, float(stated.u), options.draws, stream)
    paths = list(zip(*drawn, strict=True))
    others = list(run_trials(fit, paths, compute=settings.compute, label="principles: paths"))
    own = fit((np.array(motion.folded), np.array(motion.extended)))
    principles = [
        *rows.path_rows(chain, motion, float(stated.u)),
        *rows.choice_rows(own, others),
        *rows.noise_rows(arm, stated),
        *rows.drive_rows(robot.joints, greatest, mean, std),
        *rows.lasting_rows(robot.joints, arm, motion.rate),
    ]
    lags = np.arange(LAGS + 1)
    left = lasting(arm.deviation, lags)
    names = list(robot.joints)
    return {
        "principles": pd.DataFrame(principles, columns=rows.COLUMNS),
        "principle_torques": _long(names, {"t": t}, {"holding": mean, "swaying": std}).assign(
            greatest=np.repeat(greatest, len(t))
        ),
        "principle_lasting": _long(names, {"lag": lags / motion.rate}, {"correlation": left}),
    }


def _misfit(
    ends: tuple[np.ndarray, np.ndarray],
    chain: PlanarChain,
    motion: TrajectoryOptions,
    exponent: float,
    stated: Published,
) -> float:
    """Of the path between ``ends``."""
    left = rows.left_for_clearance(stated.covariance)
    return misfit(shares(chain, motion, *ends, exponent), stated.covariance, left)


def _long(
    joints: list[str], common: dict[str, np.ndarray], each: dict[str, np.ndarray]
) -> pd.DataFrame:
    """``common`` (K,) columns and columns of ``each`` (K, n), the rows of one joint after those of
    another.
    """
    return pd.concat(
        [
            pd.DataFrame(common | {name: values[:, j] for name, values in each.items()}).assign(
                joint=joint
            )
            for j, joint in enumerate(joints)
        ],
        ignore_index=True,
    )
