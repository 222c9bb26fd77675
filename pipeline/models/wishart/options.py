"""Options of the Wishart model."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pipeline.core import validation
from pipeline.models import options
from pipeline.models.wishart.decomposition import BY_SHAPE


@validation.options(kw_only=True)
class Options(options.Options):
    estimator: Literal["paper", "likelihood"]
    decomposition: Literal["by_shape", "pivoted_lu", "qr", "qr_transposed", "given"] = BY_SHAPE
    left: list[list[float]] | None = None  # rows of J₁, of the decomposition given alone
    floor: Annotated[float, Field(gt=0, lt=1)] | None = None  # of the paper's estimator alone
    # on α₂/α₁ of the paper's estimator, which the noise at rest settles
    ratio_factor: Annotated[float, Field(gt=0)] = 1.0

    @model_validator(mode="after")
    def _values_that_go_together(self) -> Self:
        if self.estimator == "paper" and self.floor is None:
            raise validation.Fault("floor", "the paper's estimator needs a floor")
        if (self.decomposition == "given") != (self.left is not None):
            raise validation.Fault("left", "the decomposition given, and no other, needs left")
        if self.left is not None and any(len(row) != len(self.left) for row in self.left):
            raise validation.Fault("left", "must be square: the rows of J1")
        return self
