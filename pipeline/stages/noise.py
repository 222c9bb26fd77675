"""noise: what the motion does beyond the nominal step, and how far the depth camera is off the motion capture."""

from __future__ import annotations

from pathlib import Path

from pipeline import config, contracts
from pipeline.arm.model import load_arm
from pipeline.errors import SingularJacobianError
from pipeline.motion.noise import process_noise
from pipeline.perception.depth_noise import errors_of, leave_one_out

INGEST, TRACK, ARTICULATE, OUT = Path("data/ingest"), Path("data/track"), Path("data/articulate"), Path("data/noise")


def run() -> None:
    """Process noise of the training takes; mean and covariance of the Kinect noise, leaving out each test take in turn."""
    settings = config.sections("noise")
    robot = settings.dataset.robot
    chain = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain
    joints = contracts.read("joints", TRACK)
    trajectory = contracts.read("trajectory", INGEST)
    steps = trajectory[["vx", "vz", "vphi"]].to_numpy()[:-1] / settings.dataset.motion.rate
    training = joints[joints.part == "training"]
    with contracts.replacing(OUT) as folder:
        names, q = contracts.stacked(training, ["q1", "q2", "q3"])
        try:
            noise = process_noise(chain, q, steps)
        except SingularJacobianError as error:
            take, k = error.evidence["index"]
            raise SingularJacobianError(error.message, take=names[take], step=k, q=error.evidence["q"]) from None
        rows = training.loc[training.k > 0, ["take", "part", "k", "t"]]
        contracts.write(rows.assign(**{f"w{j + 1}": noise[..., j].ravel() for j in range(3)}), "process_noise", folder)
        if contracts.exists("angles", ARTICULATE):
            errors = errors_of(contracts.read("angles", ARTICULATE), joints)
            contracts.write(leave_one_out(errors, window=settings.articulation.noise_window), "kinect_noise", folder)
        else:
            print("noise: no joint angles from a depth camera; its noise is left out")
