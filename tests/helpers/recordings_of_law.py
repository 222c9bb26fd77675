"""A project with recordings drawn from a known model, for the stages that fit and score."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import OmegaConf
from planar_poses import load_arm

from pipeline.arm.chain import PlanarChain
from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.columns import PLANE, spread
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.steps import process_noise

ROOT = Path(__file__).parents[2]
JOINTS = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
INGEST = Path("data/ingest/motion")
TRACK = Path("data/track")
TAKES = 12
STEPS = 80
REST = 20
RATE = 100.0  # 1/s
TRUE = GaussianModel(alpha=0.05, u=25.0)
MEASUREMENT = np.array([[4.0, -1.0, 0.0], [-1.0, 5.0, 1.0], [0.0, 1.0, 3.0]]) * 1e-7
MODELS = {  # option → what the stage fit would have written
    "gaussian": {"kind": "gaussian", "alpha": 0.05, "u": 25.0},
    "additive": {"kind": "additive", "noise_covariance": (np.eye(3) * 4e-6).tolist()},
    "wishart": {"kind": "wishart", "sigma_b": 1.2, "decomposition": "pivoted_lu"},
}


def write_options(folder: Path) -> None:
    """Write the smoke configuration with the MODELS in ``folder``, the current folder."""
    for name in ("pipeline", "dvc.yaml"):
        (folder / name).symlink_to(ROOT / name)

    params = OmegaConf.load(ROOT / "params.yaml")
    params.update({"scale": "smoke", "compute": "serial", "models": list(MODELS)})
    params.overrides = {"scale": {"readings": None}}  # all readings
    OmegaConf.save(params, "params.yaml")
    config.write_config(Path("params.yaml"))


def drawn_takes(chain: PlanarChain) -> tuple[np.ndarray, np.ndarray]:
    """(2·TAKES, STEPS + 1, 3) measured poses in rad that TRUE draws; the commands (STEPS, 3)."""
    middle = np.array([1.1, -1.6, 1.8])
    size = np.array([1.0, -1.0, 0.5])
    moving = np.maximum(np.arange(STEPS + 1) - REST, 0)
    swing = 0.2 * np.cos(moving / 20)
    path = middle + swing[:, None] * size
    steps = np.diff(path, axis=0)
    v = np.matvec(chain.jacobian(path[:-1]), steps)

    rng = np.random.default_rng(1)
    takes = 2 * TAKES
    q = np.empty((takes, STEPS + 1, 3))
    q[:, 0] = path[0]
    for k in range(STEPS):
        moved, _ = draw_steps(TRUE, chain, q[:, k], v[k], rng)
        errors = rng.multivariate_normal(np.zeros(3), MEASUREMENT, takes)
        q[:, k + 1] = moved + errors

    return q, v


def write_project(folder: Path) -> tuple[PlanarChain, np.ndarray, np.ndarray]:
    """Recordings drawn from TRUE, at rest in the first steps, and the fits of MODELS in ``folder``,
    the current folder of the process.

    Returns the chain, joint angles (2·TAKES, STEPS + 1, 3) in rad and commanded steps (STEPS, 3).
    """
    write_options(folder)
    robot = config.sections("fit", item="gaussian").dataset.robot
    chain = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain
    q, v = drawn_takes(chain)
    for place in (INGEST, TRACK):
        place.mkdir(parents=True)

    k = np.arange(STEPS + 1)
    speed = np.zeros((STEPS + 1, 3))
    speed[:-1] = v * RATE
    path = {"k": k, "t": k / RATE} | spread("x", PLANE, np.zeros_like(speed))
    path |= spread("v", PLANE, speed)
    contracts.write(pd.DataFrame(path), "trajectory", INGEST)

    contracts.write(rows(q, "q").assign(residual=0.0), "joints", TRACK)
    noise = rows(np.pad(process_noise(chain, q, v), ((0, 0), (1, 0), (0, 0))), "w")
    noise = noise[(noise.k > 0) & (noise.part == "training")]
    contracts.write(noise, "process_noise", TRACK)

    for name, parameters in MODELS.items():
        file = Path(f"data/fit/{name}/parameters.json")
        file.parent.mkdir(parents=True)
        file.write_text(json.dumps(parameters))
    return chain, q, v


def rows(values: np.ndarray, family: str) -> pd.DataFrame:
    """``values`` (2·TAKES, STEPS + 1, 3) as a table, the first half of the takes for training."""
    grid = STEPS + 1
    names = [f"take_{number:02d}" for number in range(2 * TAKES)]
    k = np.tile(np.arange(grid), 2 * TAKES)

    step = {
        "take": np.repeat(names, grid),
        "part": np.repeat(["training", "test"], TAKES * grid),
        "k": k,
        "t": k / RATE,
    }
    return pd.DataFrame(step | spread(family, JOINTS, values))
