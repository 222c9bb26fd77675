"""What the arm's controller logs: the commanded angles, and those that its encoders read."""

from __future__ import annotations

import numpy as np

from pipeline.laboratory.dynamics import Swing, joints_at
from pipeline.laboratory.options import EncoderOptions, TrajectoryOptions
from pipeline.laboratory.swing import desired_joints


def log_joints(
    swing: Swing, trajectory: TrajectoryOptions, options: EncoderOptions
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (N,) in s on the motion clock, from its start to its end, and the signals ``target``
    and ``actual``, each (N, n) in rad.

    The encoders sit at the motors: they read what the servo makes of the command, to their
    resolution, and know nothing of the zeros' errors and of what happens behind the gears.
    """
    t = np.arange(int(trajectory.duration * options.rate) + 1) / options.rate
    felt = joints_at(t, swing.t, swing.servo)
    actual = np.round(felt / options.resolution) * options.resolution
    return t, {"target": desired_joints(t, trajectory)[0], "actual": actual}
