"""Options of the Wishart model."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.core.errors import ConfigError
from pipeline.models import options
from pipeline.models.wishart.decomposition import BY_SHAPE, COMPUTED

ESTIMATORS = ("moments", "paper", "likelihood")


@dataclass
class Options(options.Options):
    """``estimator``: ``moments`` (the recorded total variance), ``paper`` (the convex problem on
    every step) or ``likelihood``.
    """

    estimator: str = "moments"
    decomposition: str = BY_SHAPE  # or pivoted_lu, qr, qr_transposed or given
    left: list[list[float]] | None = None  # rows of J₁, of the decomposition given alone
    # of the paper's estimator alone: ε of B⁻¹ ⪰ εI, and the factor on α₂/α₁, which follows from
    # the noise at rest
    floor: float = 0.2
    ratio_factor: float = 1.0

    def __post_init__(self) -> None:
        options.require_choice("estimator", self.estimator, ESTIMATORS)
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
