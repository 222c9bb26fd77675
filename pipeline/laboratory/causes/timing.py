"""Frames whose time is wrong: the arm moves as commanded, with drive noise of the size that logs of
real youBots show, and each frame of the motion capture shows the arm earlier or later than its time
says. The joints share this error, each in proportion to its speed.
"""

from pipeline.core.validation import options
from pipeline.laboratory.options import DynamicsOptions, NotNegative


@options(frozen=True)
class Options(DynamicsOptions):
    """Error of the frames' times and play that give the published covariance (../README.md)."""

    # 1, over the commanded speed: 0.3 to 0.7 mrad per step of 10 ms; real youBots: 0.3 to 1.4
    speed_error_std: NotNegative = 0.07
    clearance: NotNegative = 0.041  # rad
    jitter_std: NotNegative = 9e-3  # s, frames that are stamped when they arrive
