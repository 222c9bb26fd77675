"""The cameras, how they err, and the scene before the depth camera."""

from __future__ import annotations

from dataclasses import field
from math import pi

from pipeline.core.errors import ConfigError
from pipeline.core.validation import options


@options(frozen=True)
class MocapOptions:
    """Errors and faults of the marker tracking. Rates are probabilities that a burst starts at a
    frame.
    """

    # m, white, each axis; Aurand, Dufour, Marras, J. Biomech. 58 (2017): errors below 0.2 mm in 97
    # % of the volume
    noise_std: float = 1e-4
    # m, each axis, one draw a session; assumed: markers placed by hand with a ruler
    placement_std: float = 5e-4
    # 1/frame, each marker; assumed: cables and the arm itself pass before single cameras
    occlusion_rate: float = 1e-3
    occlusion_frames: float = 6.0  # frames, mean of the geometric length
    # 1/frame, each link; assumed: rare, the three markers of a link being much alike
    swap_rate: float = 1e-4
    swap_frames: float = 3.0  # frames, mean
    lost_label_rate: float = 3e-4  # 1/frame, each marker; assumed
    lost_label_frames: float = 4.0  # frames, mean

    def __post_init__(self) -> None:
        if min(self.noise_std, self.placement_std) < 0:
            raise ConfigError(
                "laboratory.mocap: a standard deviation cannot be negative",
                noise=self.noise_std,
                placement=self.placement_std,
            )
        for fault in ("occlusion", "swap", "lost_label"):
            rate, mean = getattr(self, f"{fault}_rate"), getattr(self, f"{fault}_frames")
            if not 0 <= rate <= 1 or mean < 1:
                raise ConfigError(
                    f"laboratory.mocap: {fault}_rate must be a probability and {fault}_frames "
                    "at least 1",
                    rate=rate,
                    frames=mean,
                )


@options(frozen=True)
class SceneOptions:
    """Sizes of the arm's solids and of the room; m. Girths are those of the youBot's housings,
    rounded, the room is assumed.
    """

    link_width: float = 0.06  # across the segment in the plane, first two links
    # along the normal; they differ, as bolted housings do
    link_depths: tuple[float, float, float] = (0.07, 0.06, 0.05)
    tool_width: float = 0.05  # wrist and hand
    # 1, share of the third segment that wrist and hand take; the rest are fingers
    hand_share: float = 0.62
    finger_width: float = 0.024
    finger_depth: float = 0.03
    base_width: float = 0.08  # turntable under O1
    base_gap: float = 0.04  # from O1 down to the turntable
    # column that carries the arm, slender enough for the tool to swing past it
    stand_width: float = 0.1
    floor_height: float = -0.75  # height of the floor in the arm's base frame
    # from the arm's plane to the wall behind it; more than 4.5 m from the camera, as in a hall
    wall_distance: float = 3.6


@options(frozen=True)
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
    # m, depth of a valid pixel; Microsoft's specification of the Kinect v2
    range: tuple[float, float] = (0.5, 4.5)
    # m, 1, 1/m, and m^(-1/2): σ_z = a + b z + c z² + d z^(3/2) θ²/(π/2 − θ)²; Fankhauser et al.,
    # ICAR 2015, Kinect v2 indoors
    axial: tuple[float, float, float, float] = (1.5e-3, -0.5e-3, 0.3e-3, 0.1e-3)
    # px: σ_L = a + b θ/(π/2 − θ); Nguyen, Izadi, Lovell, 3DIMPVT 2012
    lateral: tuple[float, float] = (0.8, 0.035)
    # rad (80°), no depth beyond; Nguyen 2012 and Fankhauser 2015 measure none past it
    grazing_limit: float = 1.4
    # 1, depths of neighbours that differ by more than this share are an edge
    edge_ratio: float = 0.03
    edge_lost: float = 0.3  # 1, probability of no depth at an edge; assumed
    # 1, probability of a depth between the two sides (flying pixel); assumed
    edge_mixed: float = 0.15
    # m, one draw a session; 1.5 mm to centimetres: Corti et al., Rob. Auton. Syst. 75 (2016)
    bias_offset_std: float = 5e-3
    # m, amplitude of the harmonic 'wiggling' error that Corti et al. (2016) report; its size
    # assumed
    bias_wiggle: float = 2e-3
    bias_period: float = 0.47  # m, a quarter of the 1.87 m over which the phase at 80 MHz repeats
    scene: SceneOptions = field(default_factory=SceneOptions)

    def __post_init__(self) -> None:
        if not 0 < self.range[0] < self.range[1]:
            raise ConfigError(
                "laboratory.kinect.range: must be two growing depths above zero", range=self.range
            )
        if min(self.edge_lost, self.edge_mixed) < 0 or self.edge_lost + self.edge_mixed > 1:
            raise ConfigError(
                "laboratory.kinect: edge_lost and edge_mixed must be probabilities of exclusive "
                "events",
                edge_lost=self.edge_lost,
                edge_mixed=self.edge_mixed,
            )
        if not 0 < self.grazing_limit < pi / 2:
            raise ConfigError(
                "laboratory.kinect.grazing_limit: must lie between 0 and π/2 rad",
                grazing_limit=self.grazing_limit,
            )


@options(frozen=True)
class ClockOptions:
    """The depth camera's own clock and frame rate."""

    rate: float = 30.0  # 1/s, frames of the Kinect v2
    # s, its clock minus the motion clock; assumed: two programs started by hand
    offset: float = 0.14
    offset_std: float = 0.02  # s, from take to take
    drift: float = 3e-5  # 1, rate error of the quartz
    jitter_std: float = 2e-3  # s, of a frame's exposure; USB scheduling of a PC

    def __post_init__(self) -> None:
        if self.rate <= 0 or min(self.offset_std, self.jitter_std) < 0 or self.drift <= -1:
            raise ConfigError(
                "laboratory.clock: rate must be positive, the standard deviations not negative, "
                "drift above -1",
                rate=self.rate,
            )
