"""Options of the Wishart model."""

from __future__ import annotations

from dataclasses import dataclass

from omegaconf import MISSING

from pipeline.core.errors import ConfigError
from pipeline.models import options
from pipeline.models.wishart.decomposition import BY_SHAPE, COMPUTED


@dataclass
class Options(options.Options):
    """``estimator``: ``paper`` or ``likelihood``."""

    estimator: str = MISSING
    decomposition: str = BY_SHAPE  # or pivoted_lu, qr, qr_transposed or given
    left: list[list[float]] | None = None  # rows of J₁, of the decomposition given alone
    floor: float | None = None  # of the paper's estimator alone
    ratio_factor: float = 1.0  # on α₂/α₁ of the paper's estimator, which the noise at rest settles

    def __post_init__(self) -> None:
        options.require_choice("estimator", self.estimator, ("paper", "likelihood"))
        if self.estimator == "paper" and self.floor is None:
            raise ConfigError(
                "the paper's estimator of a Wishart model needs a floor", key="models.*.floor"
            )
        options.require_choice("decomposition", self.decomposition, (BY_SHAPE, *COMPUTED, "given"))
        if (self.decomposition == "given") != (self.left is not None):
            raise ConfigError(
                "the decomposition given, and no other, needs the rows of J1 as left",
                key="models.*.left",
            )
        if self.left is not None and any(len(row) != len(self.left) for row in self.left):
            raise ConfigError(
                "left must hold the rows of J1, each of as many values as there are rows",
                key="models.*.left",
            )
