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
TAKES, STEPS, REST = 12, 80, 20
TRUE = GaussianModel(alpha=0.05, u=25.0)
MEASUREMENT = np.array([[4.0, -1.0, 0.0], [-1.0, 5.0, 1.0], [0.0, 1.0, 3.0]]) * 1e-7
MODELS = {  # option → what the stage fit would have written
    "gaussian": {"kind": "gaussian", "alpha": 0.05, "u": 25.0},
    "additive": {"kind": "additive", "noise_covariance": (np.eye(3) * 4e-6).tolist()},
    "wishart": {"kind": "wishart", "sigma_b": 1.2, "decomposition": "pivoted_lu"},
}


def write_project(folder: Path) -> tuple[PlanarChain, np.ndarray, np.ndarray]:
    """Recordings drawn from TRUE, at rest in the first steps, and the fits of MODELS in ``folder``,
    the current folder of the process.

    Returns the chain, joint angles (2·TAKES, STEPS + 1, 3) in rad and commanded steps (STEPS, 3).
    """
    for name in ("pipeline", "dvc.yaml"):
        (folder / name).symlink_to(ROOT / name)
    params = OmegaConf.load(ROOT / "params.yaml")
    params.update({"scale": "smoke", "compute": "serial", "models": list(MODELS)})
    OmegaConf.save(params, "params.yaml")
    config.write_config(Path("params.yaml"))
    robot, rate = config.sections("fit", item="gaussian").dataset.robot, 100.0
    chain = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain
    middle = np.array([1.1, -1.6, 1.8])
    k = np.arange(STEPS + 1)
    path = middle + 0.2 * np.cos(np.maximum(k - REST, 0) / 20)[:, None] * np.array(
        [1.0, -1.0, 0.5]
    )
    v = np.matvec(chain.jacobian(path[:-1]), np.diff(path, axis=0))
    rng = np.random.default_rng(1)
    q = np.empty((2 * TAKES, STEPS + 1, 3))
    q[:, 0] = path[0]
    for step in range(STEPS):
        q[:, step + 1] = draw_steps(TRUE, chain, q[:, step], v[step], rng)[
            0
        ] + rng.multivariate_normal(np.zeros(3), MEASUREMENT, 2 * TAKES)
    task = np.zeros((STEPS + 1, 3))
    task[:-1] = v * rate
    for stage in ("ingest/motion", "track"):
        Path("data", stage).mkdir(parents=True)
    trajectory = (
        {"k": k, "t": k / rate}
        | spread("x", PLANE, 0 * task)
        | spread("v", PLANE, task)
    )
    contracts.write(pd.DataFrame(trajectory), "trajectory", Path("data/ingest/motion"))
    contracts.write(rows(q, "q").assign(residual=0.0), "joints", Path("data/track"))
    noise = rows(np.pad(process_noise(chain, q, v), ((0, 0), (1, 0), (0, 0))), "w")
    contracts.write(
        noise[(noise.k > 0) & (noise.part == "training")],
        "process_noise",
        Path("data/track"),
    )
    for name, parameters in MODELS.items():
        Path(f"data/fit/{name}").mkdir(parents=True)
        Path(f"data/fit/{name}/parameters.json").write_text(json.dumps(parameters))
    return chain, q, v


def rows(values: np.ndarray, family: str) -> pd.DataFrame:
    """``values`` (2·TAKES, STEPS + 1, 3) as a table, the first half of the takes for training."""
    k = np.tile(np.arange(STEPS + 1), 2 * TAKES)
    take = np.repeat([f"take_{i:02d}" for i in range(2 * TAKES)], STEPS + 1)
    part_of_take = np.repeat(["training", "test"], TAKES * (STEPS + 1))
    step = {"take": take, "part": part_of_take, "k": k, "t": k / 100.0}
    return pd.DataFrame(step | spread(family, JOINTS, values))
