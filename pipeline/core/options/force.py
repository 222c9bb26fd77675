"""Options of the force transducer and of the robots that pull at it."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Self

from pydantic import Field, model_validator

from pipeline.core.options.analysis import Bounds, Positive
from pipeline.core.options.logs import ForceLog
from pipeline.core.options.motion_capture import Triple
from pipeline.core.validation import Fault, options


@options()
class Configuration:
    """One arrangement of the cooperating robots: what is known of each cable, and the bounds given
    for the model.
    """

    file: str
    direction: list[float]  # rad, mean direction of each cable; in space its azimuth
    tension: list[float]  # N, mean tension of each cable
    direction_bounds: Bounds  # rad
    # rad, mean elevation of each cable above the x-y plane; null: the cables lie in it
    elevation: list[float] | None = None
    elevation_bounds: Bounds | None = None  # rad
    # m, where each cable is tied, from the point of the moments, in the transducer's axes; null:
    # all in that point, and forces alone are modelled
    attachment: list[list[float]] | None = None
    attachment_bounds: Bounds | None = None  # m, of each coordinate

    @model_validator(mode="after")
    def _one_value_a_cable(self) -> Self:
        cables, axes = len(self.direction), 2 if self.elevation is None else 3
        if len(self.tension) != cables:
            raise Fault("tension", f"must hold {cables} values, one a cable as direction")
        for name, rows in (("elevation", self.elevation), ("attachment", self.attachment)):
            if (rows is None) != (getattr(self, f"{name}_bounds") is None):
                raise Fault(name, f"{name} and {name}_bounds go together")
            if rows is not None and len(rows) != cables:
                raise Fault(name, f"must hold one {name} for each of {cables} cables")
        if any(len(place) != axes for place in self.attachment or []):
            raise Fault("attachment", f"each attachment must have {axes} coordinates")
        return self


@options(kw_only=True)
class Force:
    tare: Annotated[float, Field(ge=0)]  # s, unloaded at the start of each record
    tension_std: list[float]  # N, of each robot, or of the first of them where fewer pull
    kappa_bounds: Bounds  # 1, the paper's σ_θ
    tension_std_bounds: Bounds  # N
    tension_bounds: Bounds  # N
    configurations: dict[str, Configuration]
    # m, the point that moments are taken about, in the transducer's axes from its origin
    point: Triple = field(default_factory=lambda: [0.0, 0.0, 0.0])
    length: Positive = 1.0  # m by which moments are divided where they stand beside forces
    log: ForceLog = field(default_factory=ForceLog)
