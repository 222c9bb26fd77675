"""``python -m pipeline plan MODEL PATH OUT``: joint motion of least summed uncertainty along a task
path, for the arm of params.yaml's dataset, from a fitted model.

The motion respects the joints' limits of angle and speed and a margin from singular poses. OUT
contains the commanded trajectory, joints.csv, and a figure, plan.png. With n joints and m task
coordinates, the search is globally optimal up to its grid for n = m + 1, and selects the branch of
the inverse kinematics for n = m; n > m + 1 is an error.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import Chain
from pipeline.arm.model import chain_of
from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.columns import PLANE, SPACE, columns, members, spread
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Robot
from pipeline.figures.style import (
    BLACK,
    GREY,
    PNG_RESOLUTION,
    TWO_COLUMNS,
    joint_lines,
    panels,
)
from pipeline.formats.format import format_of
from pipeline.formats.trajectory import (
    FORMAT,
    read_poses,
    read_trajectory,
    write_trajectory,
)
from pipeline.models.kinds import fitted_model
from pipeline.planning.motions import POINTS, Planned, least_uncertain
from pipeline.planning.problem import Problem, uncertainty

FITS = Path("data/fit")
JOINTS, PICTURE = "joints.csv", "plan.png"
UNITS = {"trace": "tr Cov (rad²)", "log_det": "ln det Cov"}


def run(
    model: str,
    path: Path,
    out: Path,
    objective: str = "trace",
    margin: float = 0.01,
    smoothness: float = 0.0,
    points: int = POINTS,
) -> None:
    """Write the plan, and print its cost and least singular value."""
    if out.is_file() or {file.name for file in out.glob("*")} - {JOINTS, PICTURE}:
        raise ConfigError(
            "OUT exists and contains no plan; name another folder", file=out
        )
    robot = config.sections("track").dataset.robot
    chain = chain_of(robot)
    poses, rate = read_path(path, chain, robot)
    problem = Problem(chain, poses, rate, margin, smoothness)
    fitted = fitted_model(Path(model) if Path(model).is_dir() else FITS / model)
    planned = least_uncertain(problem, uncertainty(fitted, chain, objective), points)
    t = np.arange(len(poses)) / rate
    with contracts.replacing(out) as place:
        table = pd.DataFrame({"t": t} | spread("q", robot.joints, planned.joints))
        write_trajectory(place / JOINTS, table)
        _draw(planned, margin, t, robot.joints, UNITS[objective], place / PICTURE)
    print(
        f"plan: {len(poses) - 1} steps; sum of {UNITS[objective]} {planned.cost.sum():.6g}; least "
        f"singular value {planned.clearance.min():.4g} m; wrote {out / JOINTS} and {out / PICTURE}"
    )


def read_path(file: Path, chain: Chain, robot: Robot) -> tuple[np.ndarray, float]:
    """Return the poses (M+1, p) in ``file``, as ``chain.pose`` returns them, and the rate in Hz.

    The file is a commanded joint trajectory, or has the columns t and the task coordinates:
    positions in m and the rotation vector of the tip in rad. A planar arm has φ, which is 0 at zero
    joint angles. Raises RecordingError as the formats do, and for joints of another arm.
    """
    if format_of(file, [FORMAT]) and (
        joints := members(table := read_trajectory(file), "q")
    ):
        if sorted(joints) != sorted(robot.joints):
            message = f"the file has the joints {', '.join(joints)}, but the arm has "
            raise RecordingError(message + ", ".join(robot.joints), file=file, line=1)
        poses = chain.pose(table[columns("q", robot.joints)].to_numpy())
    else:
        table = read_poses(file, chain.task)
        poses, zero = (
            table[[*chain.task]].to_numpy(),
            chain.pose(np.zeros(len(chain.lower))),
        )
        if len(zero) > len(chain.task):  # rows of a pose in space
            # φ is a turn about y
            named = table.rename(columns={PLANE[2]: "ry"}).reindex(
                columns=SPACE, fill_value=0.0
            )
            turn = named[[*SPACE[3:]]].to_numpy(copy=True)
            rotation = Rotation.from_rotvec(turn).as_matrix()
            if PLANE[2] in chain.task:
                rotation = rotation @ zero[3:].reshape(3, 3)
            poses = np.hstack([named[[*SPACE[:3]]].to_numpy(), rotation.reshape(-1, 9)])
    t = table["t"].to_numpy()
    return poses, float((len(t) - 1) / (t[-1] - t[0]))


def _draw(
    planned: Planned,
    margin: float,
    t: np.ndarray,
    joints: list[str],
    unit: str,
    file: Path,
) -> None:
    """Write the figure ``file`` (PNG): joints, cost per step and least singular value over time."""
    figure, ((angles, cost, clearance),) = panels(TWO_COLUMNS, 2.5, columns=3)
    for column, line in zip(
        planned.joints.T, joint_lines(joints).values(), strict=True
    ):
        angles.plot(t, column, **line)
    cost.plot(t[:-1], planned.cost, color=BLACK)
    clearance.plot(t, planned.clearance, color=BLACK, label="planned")
    clearance.axhline(margin, color=GREY, linestyle="--", label="margin")
    clearance.legend()
    angles.set(xlabel="time (s)", ylabel="joints (rad)")
    cost.set(xlabel="time (s)", ylabel=f"{unit} of a step")
    clearance.set(xlabel="time (s)", ylabel="least singular value (m)", ylim=(0, None))
    figure.legend(
        *angles.get_legend_handles_labels(), loc="outside upper center", ncols=4
    )
    figure.savefig(file, dpi=PNG_RESOLUTION)
