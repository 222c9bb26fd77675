"""Slow deviations from the commanded path: each take stays beside the path for a large part of the
motion, and the published covariance is read as the covariance of the poses, not of the steps.
"""

from pipeline.core.validation import options
from pipeline.laboratory.options import DynamicsOptions, NotNegative, Positive


@options(frozen=True)
class Options(DynamicsOptions):
    """Slow sway and slow play that give the published covariance to the poses (../README.md)."""

    # m or rad, by task coordinate: the youBot's x, z and rotation about the tip
    sway_std: tuple[NotNegative, ...] = (0.0, 9e-4, 9.4e-3)
    sway_time: Positive = 0.15  # s, four lags of it: the deviation lasts 0.5 s
    sway_rest: NotNegative = 0.2  # 1
    clearance: NotNegative = 0.027  # rad
    clearance_time: Positive = 0.15  # s; the joint stays on one side of its play
    speed_exponent: NotNegative = 1.0  # 1, as the error of a servo that follows a speed
