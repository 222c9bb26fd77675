"""Options of the Gaussian matrix model."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pipeline.core import validation
from pipeline.models import options


@validation.options(kw_only=True)
class Options(options.Options):
    estimator: Literal["paper", "likelihood"]
    beta: Annotated[float, Field(ge=0, lt=1)] | None = None  # of the paper's estimator alone

    @model_validator(mode="after")
    def _beta_of_the_paper(self) -> Self:
        if self.estimator == "paper" and self.beta is None:
            raise validation.Fault("beta", "the paper's estimator needs a beta")
        return self
