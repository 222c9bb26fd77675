"""Options of the force transducer and of the robots that pull at it."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from pipeline.core.options.logs import ForceLog


@dataclass
class Configuration:
    """One arrangement of the cooperating robots: what is known of each cable, and the bounds given
    for the model.
    """

    file: str = MISSING
    direction: list[float] = MISSING  # rad, mean direction of each cable
    tension: list[float] = MISSING  # N, mean tension of each cable
    direction_bounds: list[float] = MISSING  # rad


@dataclass
class Force:
    tare: float = MISSING  # s, unloaded at the start of each record
    tension_std: list[float] = MISSING  # N, of each robot
    kappa_bounds: list[float] = MISSING  # 1, the paper's σ_θ
    tension_std_bounds: list[float] = MISSING  # N
    tension_bounds: list[float] = MISSING  # N
    configurations: dict[str, Configuration] = MISSING
    log: ForceLog = field(default_factory=ForceLog)
