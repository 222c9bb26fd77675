"""The cable robots and the transducer that feels them."""

from __future__ import annotations

from dataclasses import replace

from pipeline.core.errors import ConfigError
from pipeline.core.validation import options


@options(frozen=True)
class Robots:
    """What characterises the robots, one value each."""

    tension_sd: tuple[float, ...]  # N, σ_T of the tension's stationary law
    # κ of the von Mises law with the direction's mean resultant length
    concentration: tuple[float, ...]
    slip_rate: float = 20.0  # 1/s, slips of one robot; assumed: some per turn of its wheels
    # s, time constant of regaining traction; assumed: that of a wheel-speed loop
    slip_recovery: float = 0.25
    # s, correlation time of a cable's direction; assumed: the sway of a taut cable with its robot
    wander_time: float = 0.4

    def __post_init__(self) -> None:
        if len(self.tension_sd) != len(self.concentration):
            raise ConfigError(
                "laboratory.force: tension_sd and concentration need one value per robot each",
                key="robots",
            )
        if (
            min(self.tension_sd) < 0
            or min(self.concentration) <= 0
            or min(self.slip_rate, self.slip_recovery, self.wander_time) <= 0
        ):
            raise ConfigError(
                "laboratory.force: tension_sd must not be negative; concentration, rates and times "
                "must be positive",
                key="robots",
            )

    def first(self, count: int) -> Robots:
        """The first ``count`` of them, or all where there are fewer."""
        return replace(
            self,
            tension_sd=self.tension_sd[:count],
            concentration=self.concentration[:count],
        )


@options(frozen=True)
class Transducer:
    """The force/torque transducer and its acquisition; pairs are (force in N, torque in N·m), equal
    on the three axes.
    """

    rate: float = 62.5  # Hz: 1000 Hz at averaging level 16
    # sd a sample; an ATI Gamma SI-32-2.5 resolves 1/160 N and 1/2000 N·m
    noise: tuple[float, float] = (0.00625, 0.0005)
    # sd of the constant offset of a record; assumed: mounting and temperature, not yet tared
    bias: tuple[float, float] = (0.5, 0.02)
    # sd of the linear thermal drift, per s; assumed: 0.025 N in two minutes
    drift: tuple[float, float] = (2e-4, 1e-5)
    # m, from the transducer's origin to the point that the cables are tied to, or that their
    # attachments are measured from
    lever: tuple[float, float, float] = (0.0, 0.0, 0.03)

    def __post_init__(self) -> None:
        if self.rate <= 0 or min(*self.noise, *self.bias, *self.drift) < 0:
            raise ConfigError(
                "laboratory.force: the transducer's rate must be positive; noise, bias and drift "
                "not negative",
                key="transducer",
            )
