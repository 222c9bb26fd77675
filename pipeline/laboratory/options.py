"""Options of the synthetic laboratory: disturbances with unit and source. The module imports no
library of the laboratory, so that a configuration can be checked early.
"""

from dataclasses import field, replace
from math import pi
from typing import Annotated, Self

from pydantic import Field, model_validator

from pipeline.core.options.analysis import NotNegative, Positive
from pipeline.core.validation import Fault, options

Probability = Annotated[float, Field(ge=0, le=1)]
BurstLength = Annotated[float, Field(ge=1)]  # frames, mean of the geometric length


@options(frozen=True)
class TrajectoryOptions:
    """End poses of the motion, and durations of rests and ramps."""

    folded: tuple[float, ...]  # rad, joint angles of the folded pose
    extended: tuple[float, ...]  # rad, joint angles of the most extended pose
    duration: Positive = 3.2  # s, T of the paper
    rest: NotNegative = 0.08  # s, rest at the start, at the turn (twice) and at the end
    ramp: Positive = 0.3  # s, from rest to full speed and from full speed to rest
    rate: Positive = 100.0  # 1/s, steps of the motion grid

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.folded) != len(self.extended):
            raise Fault(
                "extended",
                "folded and extended must have an angle for every joint",
            )
        if 2 * self.ramp > self.duration / 2 - 2 * self.rest:
            message = f"twice rest and ramp must fit into half the duration of {self.duration} s"
            raise Fault("duration", message)
        return self


@options(frozen=True)
class DynamicsOptions:
    """Disturbances of the arm, with unit and source of the value; :mod:`pipeline.laboratory.causes`
    sets the disturbances that cause the noise.
    """

    rate: Positive = 1000.0  # 1/s, integration steps of the servo
    servo_gain: Positive = 20.0  # 1/s, position loop of the joints
    # m, error of the link lengths, one draw per session; manufacturing of a low-cost arm
    length_std: NotNegative = 3e-4
    # rad, error of each joint's zero, one draw per session; homing against a mechanical stop
    encoder_offset_std: NotNegative = 2e-3
    # rad, once-per-turn eccentricity of encoder and gear
    encoder_ripple: NotNegative = 1e-3
    # 1, over the commanded speed; torque ripple of small gears
    speed_error_std: NotNegative = 0.03
    # s, time constant of each lag of the speed error
    speed_error_time: Positive = 0.022
    # rad, start pose of a take; repeatability of homing moves
    start_std: NotNegative = 4e-3
    # m or rad, sway of the tool by task coordinate at the joints' speed limits; a cause sets it
    sway_std: tuple[NotNegative, ...] = (0.0, 0.0, 0.0)
    # s, time constant of each lag of the sway: the shortest that the motors can drive (README.md);
    # four lags of 22 ms have the bandwidth of the servo, 20 1/s
    sway_time: Positive = 0.0135
    # 1, share of the sway at rest, while the motors hold the arm
    sway_rest: NotNegative = 0.02
    # rad, half the play of one joint; the paper reports unusual clearance in the youBot's joint 3;
    # a cause sets it
    clearance: NotNegative = 0.0
    play_joint: Annotated[int, Field(ge=1)] = 3  # number of the joint with play, from 1
    # s, time constant of each lag; impacts of gear teeth
    clearance_time: Positive = 5e-3
    # rad/s, speed of the joint at which rattling fills the play
    rattle_speed: Positive = 1.5
    # 1, sway and rattling ∝ speed to this power; inertia
    speed_exponent: NotNegative = 2.0
    # s, jitter of the exposure times; trigger and USB latency
    jitter_std: NotNegative = 5e-4


@options(frozen=True)
class EncoderOptions:
    """Log of the encoders; :class:`DynamicsOptions` has the errors of the encoders' zeros."""

    rate: Positive = 125.0  # 1/s, rows of the log; as the controller of a UR5
    resolution: Positive = 4.8e-5  # rad; assumed: 17 bits per turn at the joint


@options(frozen=True)
class ClockOptions:
    """Clock and frame rate of the depth camera."""

    rate: Positive = 30.0  # 1/s, frame rate of the Kinect v2
    # s, camera clock minus motion clock; assumed: programs started by hand
    offset: float = 0.14
    offset_std: NotNegative = 0.02  # s, std of the offset over takes
    drift: Annotated[float, Field(gt=-1)] = 3e-5  # 1, rate error of the quartz
    # s, jitter of a frame's exposure; USB scheduling of a PC
    jitter_std: NotNegative = 2e-3


@options(frozen=True)
class MocapOptions:
    """Errors and faults of the marker tracking; rates are bursts per frame."""

    # m, white, per axis; Aurand, Dufour, Marras, J. Biomech. 58 (2017): below 0.2 mm in 97 %
    noise_std: NotNegative = 1e-4
    # m, per axis, one draw per session; assumed: by a ruler
    placement_std: NotNegative = 5e-4
    # 1/frame, per marker; assumed: cables before the cameras
    occlusion_rate: Probability = 1e-3
    occlusion_frames: BurstLength = 6.0
    # 1/frame, per link; assumed: the link's markers look alike
    swap_rate: Probability = 1e-4
    swap_frames: BurstLength = 3.0
    lost_label_rate: Probability = 3e-4  # 1/frame, per marker; assumed
    lost_label_frames: BurstLength = 4.0


@options(frozen=True)
class SceneOptions:
    """Sizes in m of the arm's solids (youBot's girths) and of the surroundings (assumed)."""

    link_width: float = 0.06  # across the segment in the plane, first two links
    link_depths: tuple[float, float, float] = (0.07, 0.06, 0.05)  # along the normal
    tool_width: float = 0.05  # wrist and hand
    # 1, length of wrist and hand over the third segment's length
    hand_share: float = 0.62
    finger_width: float = 0.024
    finger_depth: float = 0.03
    base_width: float = 0.08  # turntable under O1
    base_gap: float = 0.04  # from O1 down to the turntable
    stand_width: float = 0.1  # column that carries the arm
    floor_height: float = -0.75  # height of the floor in the arm's base frame
    wall_distance: float = 3.6  # from the arm's plane; more than 4.5 m from the camera


@options(frozen=True)
class KinectOptions:
    """Kinect v2: intrinsics, pose and errors."""

    width: int = 512  # px
    height: int = 424  # px
    fx: float = 365.456  # px; infrared camera of a Kinect v2, devices differ by 1 %
    fy: float = 365.456  # px
    cx: float = 254.878  # px
    cy: float = 205.395  # px
    distance: float = 1.2  # m, from the camera to the aim point along the optical axis
    # m, x and z of the aim point in the arm's plane
    aim: tuple[float, float] = (0.03, 0.17)
    yaw: float = 0.05  # rad, about the camera's y axis; a tripod put up by eye
    pitch: float = -0.04  # rad, about the camera's x axis
    roll: float = 0.01  # rad, about the optical axis
    # m, valid depths; Microsoft's specification
    range: tuple[Positive, Positive] = (0.5, 4.5)
    # m, 1, 1/m, and m^(-1/2): σ_z = a + b z + c z² + d z^(3/2) θ²/(π/2 − θ)²; Fankhauser et al.,
    # ICAR 2015, Kinect v2 indoors
    axial: tuple[float, float, float, float] = (1.5e-3, -0.5e-3, 0.3e-3, 0.1e-3)
    # px: σ_L = a + b θ/(π/2 − θ); Nguyen, Izadi, Lovell, 3DIMPVT 2012
    lateral: tuple[float, float] = (0.8, 0.035)
    # rad (80°), greatest angle with depth, and of the data of Nguyen 2012 and Fankhauser 2015
    grazing_limit: Annotated[float, Field(gt=0, lt=pi / 2)] = 1.4
    # 1, least relative depth difference of neighbours at an edge
    edge_ratio: float = 0.03
    edge_lost: Probability = 0.3  # 1, probability of no depth at an edge; assumed
    # 1, probability of a flying pixel at an edge; assumed
    edge_mixed: Probability = 0.15
    # m, one draw per session; 1.5 mm to centimetres: Corti et al., Rob. Auton. Syst. 75 (2016)
    bias_offset_std: float = 5e-3
    # m, harmonic 'wiggling' error of Corti et al. (2016); size assumed
    bias_wiggle: float = 2e-3
    # m, a quarter of the 1.87 m over which the phase at 80 MHz repeats
    bias_period: float = 0.47
    scene: SceneOptions = field(default_factory=SceneOptions)


@options(frozen=True)
class Robots:
    """Probability laws of the pulling robots; tuples have one value per robot."""

    tension_sd: tuple[NotNegative, ...]  # N, σ_T of the tension's stationary law
    concentration: tuple[Positive, ...]  # 1, κ of the von Mises law of the direction
    # 1/s, slips per robot; assumed: some per turn of the wheels
    slip_rate: Positive = 20.0
    # s, time constant of traction; assumed: wheel-speed loop
    slip_recovery: Positive = 0.25
    # s, time constant of the direction; assumed: sway of a cable
    wander_time: Positive = 0.4

    @model_validator(mode="after")
    def _one_value_each(self) -> Self:
        if len(self.tension_sd) != len(self.concentration):
            raise Fault(
                "concentration",
                "tension_sd and concentration need one value per robot",
            )
        return self

    def first(self, count: int) -> "Robots":
        """Return the first ``count`` robots, or all if there are fewer."""
        return replace(
            self,
            tension_sd=self.tension_sd[:count],
            concentration=self.concentration[:count],
        )


@options(frozen=True)
class Transducer:
    """Force/torque transducer; pairs are (force in N, torque in N·m), equal for all axes."""

    rate: Positive = 62.5  # Hz: 1000 Hz at averaging level 16
    # std of a sample; an ATI Gamma SI-32-2.5 resolves 1/160 N and 1/2000 N·m
    noise: tuple[NotNegative, NotNegative] = (0.00625, 0.0005)
    # std of a record's offset; assumed
    bias: tuple[NotNegative, NotNegative] = (0.5, 0.02)
    # std of the thermal drift/s; assumed
    drift: tuple[NotNegative, NotNegative] = (2e-4, 1e-5)
    # m, from the transducer's origin to the point where cables are tied (origin of attachments)
    lever: tuple[float, float, float] = (0.0, 0.0, 0.03)


SECTIONS = {  # of dataset.laboratory, beside its cause and the cause's dynamics
    "trajectory": TrajectoryOptions,
    "encoders": EncoderOptions,
    "clock": ClockOptions,
    "mocap": MocapOptions,
    "kinect": KinectOptions,
    "robots": Robots,
    "transducer": Transducer,
}
