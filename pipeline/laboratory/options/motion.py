"""The commanded motion, and the disturbances that the arm adds to it."""

from __future__ import annotations

from pipeline.core.errors import ConfigError
from pipeline.core.validation import options


@options(frozen=True)
class TrajectoryOptions:
    """The motion's two ends and how time is spent between them."""

    folded: tuple[float, ...]  # rad, joint angles of the folded pose
    extended: tuple[float, ...]  # rad, joint angles of the most extended pose
    duration: float = 3.2  # s, T of the paper
    rest: float = 0.08  # s, standing still at the start, at the turn (twice this) and at the end
    ramp: float = 0.3  # s, from rest to full speed and from full speed to rest
    rate: float = 100.0  # 1/s, steps of the motion grid

    def __post_init__(self) -> None:
        if len(self.folded) != len(self.extended):
            raise ConfigError(
                "laboratory.trajectory: folded and extended must have an angle for every joint",
                folded=self.folded,
                extended=self.extended,
            )
        if not (
            self.rate > 0
            and self.rest >= 0
            and 0 < 2 * self.ramp <= self.duration / 2 - 2 * self.rest
        ):
            raise ConfigError(
                "laboratory.trajectory: twice rest and twice ramp must fit into half the duration, "
                "and rate and ramp be positive",
                duration=self.duration,
                rest=self.rest,
                ramp=self.ramp,
                rate=self.rate,
            )


@options(frozen=True)
class DynamicsOptions:
    """Disturbances at the micro level, each with its unit and where its size comes from."""

    rate: float = 1000.0  # 1/s, integration steps of the servo
    servo_gain: float = 20.0  # 1/s, position loop of the joints
    # m, link lengths against the nominal ones; manufacturing and assembly of a low-cost arm, one
    # draw a session
    length_std: float = 3e-4
    # rad, zero of each joint; homing against a mechanical stop, one draw a session
    encoder_offset_std: float = 2e-3
    encoder_ripple: float = 1e-3  # rad, once-per-turn eccentricity of encoder and gear
    # 1, share of the commanded speed; friction and torque ripple of small gears
    speed_error_std: float = 0.03
    speed_error_time: float = 0.022  # s, of each of its lags
    # rad, start pose of a take against the commanded one; repeatability of homing moves
    start_std: float = 4e-3
    # m or rad, the tool's sway along and about each of the task's rows at the joints' speed limits.
    # Here x, z and the turn about the tip of the youBot; with the clearance they give the published
    # covariance of the noise: README.md
    sway_std: tuple[float, ...] = (3e-4, 1.7e-3, 0.0332)
    # s, of each of the lags that pass the sway on: as brief as the motors can drive it
    # (README.md). Four lags of 22 ms have the bandwidth of the servo, 20 1/s
    sway_time: float = 0.0135
    sway_rest: float = 0.02  # 1, share of the sway that is left at rest; motors holding
    # rad, half the play of one joint; the paper reports an unusual clearance in the youBot's third
    clearance: float = 0.039
    play_joint: int = 3  # which joint of the chain, from 1
    # s, of each of the lags of the rattling inside the play; impacts of gear teeth, no motor
    clearance_time: float = 5e-3
    rattle_speed: float = 1.5  # rad/s, speed of that joint at which the rattling fills the play
    # 1, how sway and rattling grow with speed; loads of inertia go with its square
    speed_exponent: float = 2.0
    # s, time of the exposure against the motion clock; trigger and USB latency
    jitter_std: float = 5e-4

    def __post_init__(self) -> None:
        positive = (
            "rate",
            "servo_gain",
            "speed_error_time",
            "sway_time",
            "clearance_time",
            "rattle_speed",
        )
        for name, value in vars(self).items():
            least = min(value) if name == "sway_std" else value
            if least < 0 or (least == 0 and name in positive):
                raise ConfigError(
                    f"laboratory.dynamics.{name}: must "
                    f"{'be positive' if name in positive else 'not be negative'}",
                    value=value,
                )
        if self.servo_gain >= self.rate:
            raise ConfigError(
                "laboratory.dynamics.servo_gain: must be below rate, or the servo does not settle",
                servo_gain=self.servo_gain,
                rate=self.rate,
            )


@options(frozen=True)
class EncoderOptions:
    """The controller's log of what its encoders read; their zeros' errors are the arm's own, of
    :class:`DynamicsOptions`.
    """

    rate: float = 125.0  # 1/s, rows of the log; of the controllers of UR5s
    # rad; assumed: 17 bits a turn behind the gear, as absolute encoders of such arms have
    resolution: float = 4.8e-5

    def __post_init__(self) -> None:
        if min(self.rate, self.resolution) <= 0:
            raise ConfigError(
                "laboratory.encoders: rate and resolution must be positive",
                rate=self.rate,
                resolution=self.resolution,
            )
