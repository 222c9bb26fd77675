"""What the synthetic laboratory is made of and how it errs: every disturbance an option with its
unit and its source.

Free of the libraries that the laboratory itself needs, so that the configuration can be checked
without them.
"""

from pipeline.laboratory.options.cameras import (
    ClockOptions,
    KinectOptions,
    MocapOptions,
    SceneOptions,
)
from pipeline.laboratory.options.force import Robots, Transducer
from pipeline.laboratory.options.motion import DynamicsOptions, EncoderOptions, TrajectoryOptions

__all__ = [
    "ClockOptions",
    "DynamicsOptions",
    "EncoderOptions",
    "KinectOptions",
    "MocapOptions",
    "Robots",
    "SceneOptions",
    "TrajectoryOptions",
    "Transducer",
]
