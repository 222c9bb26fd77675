"""Options of the study: the hexapod, its motion and its load."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from omegaconf import MISSING

from pipeline.arm.hexapod import LEGS, Hexapod, pose_of
from pipeline.core.errors import ConfigError


@dataclass
class Pose:
    """Of the platform's frame in the base's."""

    position: list[float] = MISSING  # m
    turn: list[float] = MISSING  # rotation vector, rad

    def vector(self) -> np.ndarray:
        """(12,) as :mod:`pipeline.arm.hexapod` has a pose."""
        return pose_of(np.array(self.position), np.array(self.turn))


@dataclass
class Load:
    """What the legs hold against, at the platform's origin in the base's axes."""

    force: list[float] = MISSING  # N
    moment: list[float] = MISSING  # N·m


@dataclass
class Options:
    """All of the study; lengths in m."""

    base: list[list[float]] = MISSING  # (6, 3)
    platform: list[list[float]] = MISSING  # (6, 3)
    home: Pose = field(default_factory=Pose)
    legs: list[float] = MISSING  # shortest and longest
    max_speed: float = MISSING  # m/s of a leg
    length: float = MISSING  # characteristic
    start: Pose = field(default_factory=Pose)
    end: Pose = field(default_factory=Pose)
    noise: float = MISSING  # of the legs over their step
    bound: float = MISSING  # of the Gaussian model over the greatest norm of J⁻¹
    shares: list[float] = MISSING  # least and greatest share of the step whose density is shown
    load: Load = field(default_factory=Load)
    thrust_sd: float = MISSING  # N
    concentration: float = MISSING  # of a leg's direction
    places: int = MISSING  # poses along the motion

    def __post_init__(self) -> None:
        for key in ("base", "platform"):
            if np.shape(getattr(self, key)) != (LEGS, 3):
                raise ConfigError(f"{key}: must hold {LEGS} joints of three coordinates", key=key)
        for pose in ("home", "start", "end"):
            for key in ("position", "turn"):
                _require_vector(getattr(getattr(self, pose), key), f"{pose}.{key}")
        for key in ("force", "moment"):
            _require_vector(getattr(self.load, key), f"load.{key}")
        for key in ("legs", "shares"):
            if not (len(getattr(self, key)) == 2 and getattr(self, key)[0] < getattr(self, key)[1]):
                raise ConfigError(f"{key}: must hold two growing values", key=key)
        for key in ("length", "noise"):
            if not 0 < getattr(self, key) < np.inf:
                raise ConfigError(f"{key}: must be a positive number", key=key)
        if not self.bound > 1:
            raise ConfigError("the bound must be above every norm: more than 1", key="bound")

    def hexapod(self) -> Hexapod:
        """The robot; raises ConfigError where its legs do not hold it at home."""
        return Hexapod(
            base=np.array(self.base),
            platform=np.array(self.platform),
            home=self.home.vector(),
            lower=np.full(LEGS, self.legs[0]),
            upper=np.full(LEGS, self.legs[1]),
            max_speed=np.full(LEGS, self.max_speed),
            length=self.length,
        )


def _require_vector(values: list[float], key: str) -> None:
    if len(values) != 3 or not np.isfinite(values).all():
        raise ConfigError(f"{key}: must hold three numbers", key=key)
