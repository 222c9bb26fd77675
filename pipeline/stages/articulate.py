"""articulate: joint angles of depth frames by least squares (Eq. KinObj), and their errors."""

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm, arm_of
from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.perception.depth_noise import errors_of, leave_one_out
from pipeline.recordings import depth_takes

OUT = Path("data/articulate")


def run() -> None:
    """Write joint angles, the moments of their errors, and two frames with nodes for the figure."""
    settings = config.sections("articulate")
    robot = settings.dataset.robot
    o = settings.articulation
    with contracts.replacing(OUT) as folder:
        if settings.dataset.depth is None:
            print("articulate: the dataset has no depth camera; nothing to do")
            return
        takes = depth_takes.kept_takes()
        angles = depth_takes.articulate_takes(takes, robot, o, settings.compute)
        contracts.write(angles, "angles", folder)
        errors = errors_of(angles, contracts.read("joints", depth_takes.TRACK))
        if warning := depth_takes.bias_warning(errors):
            print(f"articulate: {warning}")
        noise = leave_one_out(errors, window=o.noise_window)
        contracts.write(noise, "kinect_noise", folder)
        clouds = []
        skeletons = []
        for name in ("initial", "extended"):
            cloud, skeleton = _view(name, angles, takes[0], arm_of(robot))
            clouds.append(cloud)
            skeletons.append(skeleton)
        contracts.write(pd.concat(clouds, ignore_index=True), "cloud", folder)
        contracts.write(pd.concat(skeletons, ignore_index=True), "skeleton", folder)


def _view(
    name: str,
    angles: pd.DataFrame,
    rows: pd.DataFrame,
    arm: Arm,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return points and nodes of the first take's initial frame or most extended frame."""
    take = angles[angles["take"] == rows["take"].iloc[0]]
    origin = arm.chain.origin
    shown = take.iloc[0]
    if name != "initial":
        reach = np.hypot(take["xe"] - origin[0], take["ze"] - origin[1])
        shown = take.iloc[int(reach.argmax())]
    clouds = depth_takes.arm_points(rows, depth_takes.DEPTH)
    by_frame = dict(zip(rows["frame"], clouds, strict=True))
    x, z = by_frame[int(shown["frame"])].T[:2]
    cloud = pd.DataFrame({"view": name, "x": x, "z": z})
    nodes = [origin]
    for node in "23e":
        nodes.append([shown[f"x{node}"], shown[f"z{node}"]])
    x, z = np.vstack(nodes).astype(float).T
    skeleton = pd.DataFrame({"view": name, "node": np.arange(4), "x": x, "z": z})
    return cloud, skeleton
