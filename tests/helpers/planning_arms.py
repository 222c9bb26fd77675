"""Arms that follow a path with their tip, and models to plan under."""

from dataclasses import replace

import numpy as np
from space_arms import LWR4, YOUBOT

from pipeline.arm.model import chain_of
from pipeline.studies.planning.solver import PathTask

# a robot and two poses between which it moves, rad
ARMS = {
    "planar": (replace(YOUBOT, task=["x", "z"]), [1.47, -4.0, 2.0], [2.26, -3.2, 2.79]),
    "square": (YOUBOT, [1.47, -4.0, 2.0], [2.0, -3.4, 2.3]),
    "seven": (
        LWR4,
        [0.3, 0.95, -0.3, -1.6, 0.4, 1.05, 0.2],
        [0.0, 0.65, 0.0, -1.2, 0, 0.75, 0.5],
    ),
}
LAWS = {
    "gaussian": {"kind": "gaussian", "alpha": 0.1, "u": 60.0},
    "qr_transposed": {
        "kind": "wishart",
        "sigma_b": 0.25,
        "decomposition": "qr_transposed",
    },
    "pivoted_lu": {"kind": "wishart", "sigma_b": 0.25, "decomposition": "pivoted_lu"},
}


def path_task(arm: str, steps: int) -> PathTask:
    """Path of an arm whose joints move from rest to rest in two seconds."""
    robot, start, end = ARMS[arm]
    chain = chain_of(robot)

    phase = np.linspace(0, np.pi, steps + 1)
    share = (1 - np.cos(phase)) / 2
    stroke = np.subtract(end, start)
    q = start + share[:, None] * stroke
    return PathTask(chain, chain.pose(q), rate=steps / 2, margin=0.02)
