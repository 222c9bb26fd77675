"""``python -m pipeline plan MODEL PATH OUT``: the joint motion of least summed uncertainty along a
task path, for the arm of the configured dataset, from a fitted model.

The motion keeps the joints' limits of angle and speed and a margin from singular poses. OUT holds
the commanded trajectory, joints.csv, and a picture, plan.png. The search is globally optimal to its
grid for an arm of one joint more than task rows, and decides the branch of an arm that has as many
joints as rows; an arm with more joints is refused.
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
from pipeline.figures.style import BLACK, GREY, PNG_RESOLUTION, TWO_COLUMNS, joint_lines, panels
from pipeline.formats.trajectory import write_trajectory
from pipeline.models.kinds import fitted_model
from pipeline.planning.motions import POINTS, Planned, least_uncertain
from pipeline.planning.problem import OBJECTIVES, Problem, uncertainty
from pipeline.tools.plan.path_file import read_path

FITS = Path("data/fit")
JOINTS, PICTURE = "joints.csv", "plan.png"
UNITS = {"trace": "tr Cov (rad²)", "log_det": "ln det Cov"}


def run(words: list[str]) -> None:
    """Plan, write, and print cost and least singular value."""
    arguments = _parser().parse_args(words)
    out, objective = arguments.out, arguments.objective
    if out.exists() and (
        not out.is_dir() or {file.name for file in out.iterdir()} - {JOINTS, PICTURE}
    ):
        raise ConfigError("OUT exists and is no plan; name another folder", file=out)
    robot = config.sections("track").dataset.robot
    chain = chain_of(robot)
    path, rate = read_path(arguments.path, chain, robot)
    problem = Problem(chain, path, rate, arguments.margin, arguments.smoothness)
    folder = Path(arguments.model)
    model = fitted_model(folder if folder.is_dir() else FITS / arguments.model)
    planned = least_uncertain(problem, uncertainty(model, chain, objective), arguments.points)
    t = np.arange(len(path)) / rate
    with contracts.replacing(out) as place:
        table = pd.DataFrame({"t": t} | spread("q", robot.joints, planned.joints))
        write_trajectory(place / JOINTS, table)
        _draw(planned, problem, t, robot.joints, UNITS[objective], place / PICTURE)
    print(
        f"{out}: {len(path) - 1} steps; summed {objective} of the covariance "
        f"{planned.cost.sum():.6g}; least singular value {planned.clearance.min():.4g} m"
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m pipeline plan", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("model", metavar="MODEL", help=f"model in {FITS}, or its folder")
    columns = (
        "CSV with the columns t (s) and the rows of the task by name: x, y, z (m), rx, ry, rz "
        "(rad, the rotation vector of the tip in the base's axes), in a plane x, z, phi; or a "
        "commanded trajectory of the joints, t and q:JOINT, whose poses are the path"
    )
    parser.add_argument("path", metavar="PATH", type=Path, help=columns)
    folder = "folder of the plan, new or of an earlier plan, which it replaces"
    parser.add_argument("out", metavar="OUT", type=Path, help=folder)
    known = {"choices": OBJECTIVES, "default": OBJECTIVES[0]}
    objective = (
        "sum over the steps; ln det is in the row space of the Jacobian where it has its rank"
    )
    parser.add_argument("--objective", **known, help=f"{objective} (default %(default)s)")
    for name, default, text in (
        ("margin", 0.01, "m, least singular value of the Jacobian, angular rows times the length"),
        ("smoothness", 0.0, "weight of the squared steps in the null space, objective per rad²"),
        ("points", POINTS, "points of the grid, a step"),
    ):
        text = f"{text} (default %(default)s)"
        parser.add_argument(f"--{name}", type=type(default), default=default, help=text)
    return parser


def _draw(
    planned: Planned, problem: Problem, t: np.ndarray, joints: list[str], unit: str, file: Path
) -> None:
    """Write ``file``, a PNG: joints, cost of the steps and least singular value over time."""
    figure, ((angles, cost, clearance),) = panels(TWO_COLUMNS, 2.5, columns=3)
    for column, line in zip(planned.joints.T, joint_lines(joints).values(), strict=True):
        angles.plot(t, column, **line)
    angles.set(ylabel="joints (rad)")
    cost.plot(t[:-1], planned.cost, color=BLACK)
    cost.set(ylabel=f"{unit} of a step")
    clearance.plot(t, planned.clearance, color=BLACK, label="planned")
    clearance.axhline(problem.margin, color=GREY, linestyle="--", label="margin")
    clearance.set(ylabel="least singular value (m)", ylim=(0, None))
    clearance.legend()
    for axes in (angles, cost, clearance):
        axes.set(xlabel="time (s)")
    figure.legend(*angles.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    figure.savefig(file, dpi=PNG_RESOLUTION)
