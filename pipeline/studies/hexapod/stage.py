"""hexapod: a parallel robot under the same models, and its dual, the wrench of its legs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core import config, contracts
from pipeline.studies import page
from pipeline.studies.hexapod.load import legs_of, thrust_rows, wrench_rows
from pipeline.studies.hexapod.motion import (
    Motion,
    density_rows,
    models_of,
    motion_rows,
    straight,
)
from pipeline.studies.hexapod.options import Options
from pipeline.studies.hexapod.words import TITLE, Facts, sections

HERE, OUT = Path(__file__).parent, page.DATA / "hexapod"


def run() -> None:
    """Work out the laws of motion and wrench along the option file's motion, and write the page."""
    settings = config.sections("hexapod", HERE / "dvc.yaml")
    tables, facts = worked(config.study_options(HERE, Options))
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("hexapod", {}, settings.compute)
    page.write_page("hexapod", TITLE, sections(tables, facts))


def worked(options: Options) -> tuple[dict[str, pd.DataFrame], Facts]:
    """The study's tables, and what its page says beside them; raises ConfigError,
    SingularJacobianError and SolverError for a robot or motion that cannot be.
    """
    robot = options.hexapod()
    motion = straight(robot, options.start, options.end, options.places)
    models, places = models_of(motion, options), np.linspace(0, 1, options.places)
    system = legs_of(motion, options)
    wrench, matrix = wrench_rows(system, places)
    tables = {
        "hexapod_legs": _legs(motion),
        "hexapod_motion": motion_rows(models, motion),
        "hexapod_density": density_rows(models, motion, options.shares),
        "hexapod_thrust": thrust_rows(system, places),
        "hexapod_wrench": wrench,
    }
    ways = {"home": robot.pose(motion.q), "the last pose": robot.follow(motion.q)}
    return tables, Facts(
        reached={
            name: float(np.abs(robot.displacement(motion.pose, way)).max())
            for name, way in ways.items()
        },
        noise=options.noise,
        sigma_b={name: models[name].sigma_b for name in ("qr_transposed", "qr")},
        matrix=matrix,
        length=robot.length,
    )


def _legs(motion: Motion) -> pd.DataFrame:
    """The table ``hexapod_legs``."""
    robot, ends = motion.robot, {"start": motion.pose[0], "end": motion.pose[-1]}
    tables = []
    for end, pose in ends.items():
        joints = np.hstack([robot.base, pose[:3] + robot.arms(pose)])
        rows = pd.DataFrame(joints, columns=["bx", "by", "bz", "px", "py", "pz"])
        tables.append(rows.assign(end=end, leg=np.arange(1, len(rows) + 1)))
    return pd.concat(tables, ignore_index=True)
