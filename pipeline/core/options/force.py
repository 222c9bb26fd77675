"""Options of the force transducer and of the robots that pull at it."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from pipeline.core.errors import ConfigError
from pipeline.core.options.logs import ForceLog


@dataclass
class Configuration:
    """One arrangement of the cooperating robots: what is known of each cable, and the bounds given
    for the model.
    """

    file: str = MISSING
    direction: list[float] = MISSING  # rad, mean direction of each cable; in space its azimuth
    tension: list[float] = MISSING  # N, mean tension of each cable
    direction_bounds: list[float] = MISSING  # rad
    # rad, mean elevation of each cable above the x-y plane; null: the cables lie in it
    elevation: list[float] | None = None
    elevation_bounds: list[float] | None = None  # rad
    # m, where each cable is tied, from the point of the moments, in the transducer's axes; null:
    # all in that point, and forces alone are modelled
    attachment: list[list[float]] | None = None
    attachment_bounds: list[float] | None = None  # m, of each coordinate

    def __post_init__(self) -> None:
        axes = 2 if self.elevation is None else 3
        for name, rows in (("elevation", self.elevation), ("attachment", self.attachment)):
            if (rows is None) != (getattr(self, f"{name}_bounds") is None):
                self._refuse(f"{name} and {name}_bounds go together", name)
            if rows is not None and len(rows) != len(self.direction):
                self._refuse(f"one {name} for each of {len(self.direction)} cables", name)
        if any(len(place) != axes for place in self.attachment or []):
            self._refuse(f"each attachment has {axes} coordinates", "attachment")

    def _refuse(self, message: str, key: str) -> None:
        raise ConfigError(
            f"{message}, in the configuration of {self.file}",
            key=f"dataset.force.configurations.*.{key}",
        )


@dataclass
class Force:
    tare: float = MISSING  # s, unloaded at the start of each record
    tension_std: list[float] = MISSING  # N, of each robot, or of the first of them where fewer pull
    kappa_bounds: list[float] = MISSING  # 1, the paper's σ_θ
    tension_std_bounds: list[float] = MISSING  # N
    tension_bounds: list[float] = MISSING  # N
    configurations: dict[str, Configuration] = MISSING
    # m, the point that moments are taken about, in the transducer's axes from its origin
    point: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    length: float = 1.0  # m by which moments are divided where they stand beside forces
    log: ForceLog = field(default_factory=ForceLog)

    def __post_init__(self) -> None:
        if len(self.point) != 3:
            raise ConfigError("point: three coordinates in m", key="dataset.force.point")
        if not 0 < self.length < float("inf"):
            raise ConfigError(
                f"length: {self.length} must be a positive number of metres",
                key="dataset.force.length",
            )
