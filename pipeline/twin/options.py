"""What the synthetic laboratory is made of and how it errs: every disturbance an option with its unit and its source.

Free of the libraries that the laboratory itself needs, so that the configuration can be checked without them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi

from pipeline.errors import ConfigError


@dataclass(frozen=True)
class TrajectoryOptions:
    """The motion's two ends and how time is spent between them."""

    folded: tuple[float, float, float]  # rad, joint angles of the folded pose
    extended: tuple[float, float, float]  # rad, joint angles of the most extended pose
    duration: float = 3.2  # s, T of the paper
    rest: float = 0.08  # s, standing still at the start, at the turn (twice this) and at the end
    ramp: float = 0.3  # s, from rest to full speed and from full speed to rest
    rate: float = 100.0  # 1/s, steps of the motion grid

    def __post_init__(self) -> None:
        if not (self.rate > 0 and self.rest >= 0 and 0 < 2 * self.ramp <= self.duration / 2 - 2 * self.rest):
            raise ConfigError(
                "twin.trajectory: twice rest and twice ramp must fit into half the duration, and rate and ramp be positive",
                duration=self.duration, rest=self.rest, ramp=self.ramp, rate=self.rate,
            )  # fmt: skip


@dataclass(frozen=True)
class DynamicsOptions:
    """Disturbances at the micro level, each with its unit and where its size comes from."""

    rate: float = 1000.0  # 1/s, integration steps of the servo
    servo_gain: float = 20.0  # 1/s, position loop of the joints
    length_std: float = 3e-4  # m, link lengths against the nominal ones; manufacturing and assembly of a low-cost arm, one draw a session
    encoder_offset_std: float = 2e-3  # rad, zero of each joint; homing against a mechanical stop, one draw a session
    encoder_ripple: float = 1e-3  # rad, once-per-turn eccentricity of encoder and gear
    speed_error_std: float = 0.03  # 1, share of the commanded speed; friction and torque ripple of small gears
    speed_error_time: float = 0.05  # s, correlation time of the speed error
    start_std: float = 4e-3  # rad, start pose of a take against the commanded one; repeatability of homing moves
    sway_std: tuple[float, float] = (3e-4, 1.5e-3)  # m, end-effector's sway along x and z at full speed; repeatability of such arms is 1 mm
    sway_time: float = 6e-3  # s, correlation time of the sway; structural modes of a light arm lie at some tens of Hz
    sway_rest: float = 0.02  # 1, share of the sway that is left at rest; motors holding
    clearance: float = 0.028  # rad, half the play of joint 3; the paper reports an unusual clearance there
    clearance_time: float = 2e-3  # s, correlation time of the rattling inside the play; impacts of gear teeth
    rattle_speed: float = 1.5  # rad/s, speed of joint 3 at which the rattling fills the play
    speed_exponent: float = 2.0  # 1, how sway and rattling grow with speed; loads of inertia go with its square
    jitter_std: float = 5e-4  # s, time of the exposure against the motion clock; trigger and USB latency

    def __post_init__(self) -> None:
        positive = ("rate", "servo_gain", "speed_error_time", "sway_time", "clearance_time", "rattle_speed")
        for name, value in vars(self).items():
            least = min(value) if name == "sway_std" else value
            if least < 0 or (least == 0 and name in positive):
                raise ConfigError(f"twin.dynamics.{name}: must {'be positive' if name in positive else 'not be negative'}", found=value)
        if self.servo_gain >= self.rate:
            raise ConfigError(
                "twin.dynamics.servo_gain: must be below rate, or the servo does not settle", found=self.servo_gain, rate=self.rate
            )


@dataclass(frozen=True)
class MocapOptions:
    """Errors and faults of the marker tracking. Rates are probabilities that a burst starts at a frame."""

    noise_std: float = 1e-4  # m, white, each axis; Aurand, Dufour, Marras, J. Biomech. 58 (2017): errors below 0.2 mm in 97 % of the volume
    placement_std: float = 5e-4  # m, each axis, one draw a session; assumed: markers placed by hand with a ruler
    occlusion_rate: float = 1e-3  # 1/frame, each marker; assumed: cables and the arm itself pass before single cameras
    occlusion_frames: float = 6.0  # frames, mean of the geometric length
    swap_rate: float = 1e-4  # 1/frame, each link; assumed: rare, the three markers of a link being much alike
    swap_frames: float = 3.0  # frames, mean
    lost_label_rate: float = 3e-4  # 1/frame, each marker; assumed
    lost_label_frames: float = 4.0  # frames, mean

    def __post_init__(self) -> None:
        if min(self.noise_std, self.placement_std) < 0:
            raise ConfigError("twin.mocap: a standard deviation cannot be negative", noise=self.noise_std, placement=self.placement_std)
        for fault in ("occlusion", "swap", "lost_label"):
            rate, mean = getattr(self, f"{fault}_rate"), getattr(self, f"{fault}_frames")
            if not 0 <= rate <= 1 or mean < 1:
                raise ConfigError(f"twin.mocap: {fault}_rate must be a probability and {fault}_frames at least 1", rate=rate, frames=mean)


@dataclass(frozen=True)
class SceneOptions:
    """Sizes of the arm's solids and of the room; m. Girths are those of the youBot's housings, rounded, the room is assumed."""

    link_width: float = 0.06  # across the segment in the plane, first two links
    link_depths: tuple[float, float, float] = (0.07, 0.06, 0.05)  # along the normal; they differ, as bolted housings do
    tool_width: float = 0.05  # wrist and hand
    hand_share: float = 0.62  # 1, share of the third segment that wrist and hand take; the rest are fingers
    finger_width: float = 0.024
    finger_depth: float = 0.03
    base_width: float = 0.08  # turntable under O1
    base_gap: float = 0.04  # from O1 down to the turntable
    stand_width: float = 0.1  # column that carries the arm, slender enough for the tool to swing past it
    floor_height: float = -0.75  # height of the floor in the arm's base frame
    wall_distance: float = 3.6  # from the arm's plane to the wall behind it; more than 4.5 m from the camera, as in a hall


@dataclass(frozen=True)
class KinectOptions:
    """The sensor, where it stands and how it errs."""

    width: int = 512  # px
    height: int = 424  # px
    fx: float = 365.456  # px; intrinsics of a Kinect v2's infrared camera, devices differ by 1 %
    fy: float = 365.456  # px
    cx: float = 254.878  # px
    cy: float = 205.395  # px
    distance: float = 1.2  # m, from the camera to the point of the arm's plane that it looks at
    aim: tuple[float, float] = (0.03, 0.17)  # m, that point's x and z in the plane
    yaw: float = 0.05  # rad, about the camera's y axis; a tripod put up by eye
    pitch: float = -0.04  # rad, about the camera's x axis
    roll: float = 0.01  # rad, about the optical axis
    range: tuple[float, float] = (0.5, 4.5)  # m, depth of a valid pixel; Microsoft's specification of the Kinect v2
    # m, 1, 1/m, and m^(-1/2): σ_z = a + b z + c z² + d z^(3/2) θ²/(π/2 − θ)²; Fankhauser et al., ICAR 2015, Kinect v2 indoors
    axial: tuple[float, float, float, float] = (1.5e-3, -0.5e-3, 0.3e-3, 0.1e-3)
    # px: σ_L = a + b θ/(π/2 − θ); Nguyen, Izadi, Lovell, 3DIMPVT 2012
    lateral: tuple[float, float] = (0.8, 0.035)
    grazing_limit: float = 1.4  # rad (80°), no depth beyond; Nguyen 2012 and Fankhauser 2015 measure none past it
    edge_ratio: float = 0.03  # 1, depths of neighbours that differ by more than this share are an edge
    edge_lost: float = 0.3  # 1, probability of no depth at an edge; assumed
    edge_mixed: float = 0.15  # 1, probability of a depth between the two sides (flying pixel); assumed
    bias_offset_std: float = 5e-3  # m, one draw a session; 1.5 mm to centimetres: Corti et al., Rob. Auton. Syst. 75 (2016)
    bias_wiggle: float = 2e-3  # m, amplitude of the harmonic 'wiggling' error that Corti et al. (2016) report; its size assumed
    bias_period: float = 0.47  # m, a quarter of the 1.87 m over which the phase at 80 MHz repeats
    scene: SceneOptions = field(default_factory=SceneOptions)

    def __post_init__(self) -> None:
        if not 0 < self.range[0] < self.range[1]:
            raise ConfigError("twin.kinect.range: must be two growing depths above zero", range=self.range)
        if min(self.edge_lost, self.edge_mixed) < 0 or self.edge_lost + self.edge_mixed > 1:
            raise ConfigError(
                "twin.kinect: edge_lost and edge_mixed must be probabilities of exclusive events",
                edge_lost=self.edge_lost, edge_mixed=self.edge_mixed,
            )  # fmt: skip
        if not 0 < self.grazing_limit < pi / 2:
            raise ConfigError("twin.kinect.grazing_limit: must lie between 0 and π/2 rad", grazing_limit=self.grazing_limit)


@dataclass(frozen=True)
class ClockOptions:
    """The depth camera's own clock and frame rate."""

    rate: float = 30.0  # 1/s, frames of the Kinect v2
    offset: float = 0.14  # s, its clock minus the motion clock; assumed: two programs started by hand
    offset_std: float = 0.02  # s, from take to take
    drift: float = 3e-5  # 1, rate error of the quartz
    jitter_std: float = 2e-3  # s, of a frame's exposure; USB scheduling of a PC

    def __post_init__(self) -> None:
        if self.rate <= 0 or min(self.offset_std, self.jitter_std) < 0 or self.drift <= -1:
            raise ConfigError("twin.clock: rate must be positive, the standard deviations not negative, drift above -1", rate=self.rate)


@dataclass(frozen=True)
class Robots:
    """What characterises the robots, one value each."""

    tension_sd: tuple[float, ...]  # N, σ_T of the tension's stationary law
    concentration: tuple[float, ...]  # κ of the von Mises law with the direction's mean resultant length
    slip_rate: float = 20.0  # 1/s, slips of one robot; assumed: some per turn of its wheels
    slip_recovery: float = 0.25  # s, time constant of regaining traction; assumed: that of a wheel-speed loop
    wander_time: float = 0.4  # s, correlation time of a cable's direction; assumed: the sway of a taut cable with its robot

    def __post_init__(self) -> None:
        if len(self.tension_sd) != len(self.concentration):
            raise ConfigError("twin.force: tension_sd and concentration need one value per robot each", key="robots")
        if min(self.tension_sd) < 0 or min(self.concentration) <= 0 or min(self.slip_rate, self.slip_recovery, self.wander_time) <= 0:
            raise ConfigError("twin.force: tension_sd must not be negative; concentration, rates and times must be positive", key="robots")


@dataclass(frozen=True)
class Transducer:
    """The force/torque transducer and its acquisition; pairs are (force in N, torque in N·m), equal on the three axes."""

    rate: float = 62.5  # Hz: 1000 Hz at averaging level 16
    noise: tuple[float, float] = (0.00625, 0.0005)  # sd a sample; an ATI Gamma SI-32-2.5 resolves 1/160 N and 1/2000 N·m
    bias: tuple[float, float] = (0.5, 0.02)  # sd of the constant offset of a record; assumed: mounting and temperature, not yet tared
    drift: tuple[float, float] = (2e-4, 1e-5)  # sd of the linear thermal drift, per s; assumed: 0.025 N in two minutes
    lever: tuple[float, float, float] = (0.0, 0.0, 0.03)  # m, from the transducer's origin to the point the cables are tied to

    def __post_init__(self) -> None:
        if self.rate <= 0 or min(*self.noise, *self.bias, *self.drift) < 0:
            raise ConfigError("twin.force: the transducer's rate must be positive; noise, bias and drift not negative", key="transducer")
