"""``python -m pipeline plan MODEL PATH OUT``: the joint motion of least summed uncertainty along a
task path, for the arm of the configured dataset, from a fitted model.

It keeps the joints' limits of angle and speed and a margin from singular poses, and is written as a
commanded trajectory, OUT/joints.csv, with a picture, OUT/plan.png. The search is globally optimal
to its grid for an arm of one joint more than task rows, and decides the branch of an arm that has
as many joints as rows; an arm with more joints is refused.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import chain_of
from pipeline.core import config, contracts
from pipeline.core.columns import spread
from pipeline.core.errors import ConfigError
from pipeline.formats.trajectory import write_trajectory
from pipeline.models.kinds import fitted_model
from pipeline.planning.motions import POINTS, least_uncertain
from pipeline.planning.problem import OBJECTIVES, Problem, uncertainty
from pipeline.tools.plan.path_file import read_path
from pipeline.tools.plan.picture import draw

FITS = Path("data/fit")
JOINTS, PICTURE = "joints.csv", "plan.png"
MARGIN = 0.01  # m


def run(words: list[str]) -> None:
    """Plan, write, and print what it comes to."""
    arguments = _parser().parse_args(words)
    _require_replaceable(arguments.out)
    robot = config.sections("track").dataset.robot
    chain = chain_of(robot)
    path, rate = read_path(arguments.path, chain, robot)
    problem = Problem(chain, path, rate, arguments.margin, arguments.smoothness)
    folder = Path(arguments.model)
    model = fitted_model(folder if folder.is_dir() else FITS / arguments.model)
    cost = uncertainty(model, chain, arguments.objective)
    planned = least_uncertain(problem, cost, arguments.points)
    table = {"t": np.arange(len(path)) / rate} | spread("q", robot.joints, planned.joints)
    with contracts.replacing(arguments.out) as out:
        write_trajectory(out / JOINTS, pd.DataFrame(table))
        draw(planned, problem, robot.joints, arguments.objective, out / PICTURE)
    print(
        f"{arguments.out}: {len(path) - 1} steps; summed {arguments.objective} of the covariance "
        f"{planned.cost.sum():.6g}; least singular value {planned.clearance.min():.4g} m"
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m pipeline plan", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("model", metavar="MODEL", help=f"a model in {FITS}, or its folder")
    parser.add_argument(
        "path",
        metavar="PATH",
        type=Path,
        help="CSV with the columns t (s) and the rows of the task by name: x, y, z (m), rx, ry, rz "
        "(rad, the rotation vector of the tip in the base's axes), in a plane x, z, phi; or a "
        "commanded trajectory of the joints, t and q:JOINT, whose poses are the path",
    )
    parser.add_argument(
        "out",
        metavar="OUT",
        type=Path,
        help="a folder, new or of a plan, which it replaces",
    )
    parser.add_argument(
        "--objective",
        choices=OBJECTIVES,
        default=OBJECTIVES[0],
        help="what is summed over the steps; ln det is in the row space of the Jacobian where the "
        "covariance has its rank (default: %(default)s)",
    )
    parser.add_argument(
        "--margin",
        type=float,
        default=MARGIN,
        help="m, that the least singular value of the Jacobian keeps, angular rows times the "
        "task's length (default: %(default)s)",
    )
    parser.add_argument(
        "--smoothness",
        type=float,
        default=0.0,
        help="weight of the squared steps in the null space of the task, in units of the objective "
        "for a rad² (default: %(default)s)",
    )
    parser.add_argument(
        "--points", type=int, default=POINTS, help="of the grid, a step (default: %(default)s)"
    )
    return parser


def _require_replaceable(out: Path) -> None:
    """Raise ConfigError where ``out`` holds anything but an earlier plan."""
    if not out.exists():
        return
    if not out.is_dir() or {file.name for file in out.iterdir()} - {JOINTS, PICTURE}:
        raise ConfigError("OUT exists and is no plan; name another folder", file=out)
