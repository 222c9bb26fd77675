"""Options of the Wishart model."""

from __future__ import annotations

from typing import Annotated, Literal, Self, get_args

from pydantic import Field, model_validator

from pipeline.core import validation
from pipeline.models import options

Estimator = Literal["moments", "paper", "likelihood"]
ESTIMATORS = get_args(Estimator)


@validation.options(kw_only=True)
class Options(options.Options):
    """``estimator``: ``moments`` (the recorded total variance), ``paper`` (the convex problem on
    every step) or ``likelihood``.
    """

    estimator: Estimator = "moments"
    decomposition: Literal["by_shape", "pivoted_lu", "qr", "qr_transposed", "given"] = "by_shape"
    left: list[list[float]] | None = None  # rows of J₁, of the decomposition given alone
    # of the paper's estimator alone: ε of B⁻¹ ⪰ εI, and the factor on α₂/α₁, which follows from
    # the noise at rest
    floor: Annotated[float, Field(gt=0, lt=1)] = 0.2
    ratio_factor: Annotated[float, Field(gt=0)] = 1.0

    @model_validator(mode="after")
    def _values_that_go_together(self) -> Self:
        if (self.decomposition == "given") != (self.left is not None):
            raise validation.Fault("left", "the decomposition given, and no other, needs left")
        if self.left is not None and any(len(row) != len(self.left) for row in self.left):
            raise validation.Fault("left", "must be square: the rows of J1")
        return self
