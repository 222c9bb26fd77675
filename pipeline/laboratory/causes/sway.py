"""Sway of the tool: the drives transmit disturbances to the tool, and the inverse Jacobian maps
them to the joints, as in the matrix models. The joints must move faster than the robot's can.
"""

from pipeline.core.validation import options
from pipeline.laboratory.options import DynamicsOptions, NotNegative


@options(frozen=True)
class Options(DynamicsOptions):
    """Sway and play that give the published covariance of the process noise (../README.md)."""

    # m or rad, by task coordinate: the youBot's x, z and rotation about the tip
    sway_std: tuple[NotNegative, ...] = (3e-4, 1.7e-3, 0.0332)
    clearance: NotNegative = 0.039  # rad
