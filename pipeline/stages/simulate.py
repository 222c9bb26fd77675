"""simulate@model: realisations of one fitted motion model, and their moments against the recordings'."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng
from pipeline.arm.model import load_arm
from pipeline.motion.build import fitted_model
from pipeline.motion.realizations import realize

INGEST, TRACK, FIT, OUT = Path("data/ingest"), Path("data/track"), Path("data/fit"), Path("data/simulate")


def run(model: str) -> None:
    """Realise ``model`` as often as the simulation's options say, from the training takes' poses in turn."""
    settings = config.sections("simulate", item=model)
    robot, motion, options = settings.dataset.robot, settings.dataset.motion, settings.simulation
    chain = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain
    joints = contracts.read("joints", TRACK)
    _, q = contracts.stacked(joints[joints.part == "training"], ["q1", "q2", "q3"])
    trajectory = contracts.read("trajectory", INGEST)
    v = trajectory[["vx", "vz", "vphi"]].to_numpy()[:-1] / motion.rate
    stream = rng.stream(settings.seed, f"simulate.{model}")
    starts = np.resize(q, (options.realizations, *q.shape[1:]))
    simulated, clipped = realize(fitted_model(FIT / model), chain, starts, v, options.mode, stream)
    grid = {"k": trajectory["k"].to_numpy(), "t": trajectory["t"].to_numpy()}
    with contracts.replacing(OUT / model) as folder:
        rows = pd.DataFrame({"realization": np.repeat(np.arange(len(simulated)), len(v) + 1)} | {c: np.tile(x, len(simulated)) for c, x in grid.items()})
        contracts.write(rows.assign(**{f"q{j + 1}": simulated[..., j].ravel() for j in range(3)}), "realizations", folder)
        spread = simulated
        if options.mode == "one_step":
            nominal = starts[:, :-1] + np.matvec(chain.inverse_jacobian(starts[:, :-1], what="measured pose"), v)
            spread = np.concatenate([np.zeros_like(starts[:, :1]), simulated[:, 1:] - nominal], axis=1)
        moments = {f"m{j + 1}": simulated.mean(axis=0)[:, j] for j in range(3)} | {f"s{j + 1}": spread.std(axis=0, ddof=1)[:, j] for j in range(3)}
        contracts.write(pd.DataFrame(grid | moments), "moments", folder)
    contracts.write_metrics({"steps_with_clipped_noise": clipped, "steps": simulated[:, 1:, 0].size}, Path(f"reports/metrics/simulate_{model}.json"))
