"""simulate@model: realisations of one fitted motion model, and their moments against the recordings'."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng
from pipeline.arm.model import load_arm
from pipeline.errors import ModelDomainError
from pipeline.motion.build import fitted_model
from pipeline.motion.gaussian import GaussianModel
from pipeline.motion.gaussian_forward import GaussianForwardModel
from pipeline.motion.realizations import realize, realized_moments

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
    fitted = fitted_model(FIT / model)
    if isinstance(fitted, GaussianModel | GaussianForwardModel):
        fitted.require_bound(chain, q.mean(axis=0))
    simulated, clipped, lost = realize(fitted, chain, starts, v, options.mode, stream)
    grid = trajectory[["k", "t"]]
    try:
        mean, deviation, refused = realized_moments(fitted, chain, starts, v, options.mode, simulated)
    except ModelDomainError as error:
        raise ModelDomainError(error.message, **{"model": model} | error.evidence) from None
    if refused:
        print(f"simulate: the spread of {model} is a gap, as a sample's would mean nothing: {refused}")
    with contracts.replacing(OUT / model) as folder:
        rows = pd.concat([grid] * len(simulated), ignore_index=True)
        rows = rows.assign(realization=np.repeat(np.arange(len(simulated)), len(grid)))
        rows = rows.assign(**{f"q{j + 1}": simulated[..., j].ravel() for j in range(3)})
        contracts.write(rows.dropna(), "realizations", folder)
        moments = {f"m{j + 1}": mean[:, j] for j in range(3)} | {f"s{j + 1}": deviation[:, j] for j in range(3)}
        contracts.write(grid.assign(**moments), "moments", folder)
    metrics = {
        "steps": simulated[:, 1:, 0].size,
        "steps_with_clipped_noise": clipped,
        "realizations_lost_at_a_singular_pose": lost,
    }
    contracts.write_metrics(metrics, Path(f"reports/metrics/simulate_{model}.json"))
