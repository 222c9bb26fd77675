"""Options of the Gaussian matrix model."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pipeline.core import validation
from pipeline.models import options

ESTIMATORS = ("moments", "paper", "likelihood")


@validation.options(kw_only=True)
class Options(options.Options):
    """``estimator``: ``moments`` (the recorded total variance, then its course over time),
    ``paper`` (the distance of one-step moments, step by step) or ``likelihood``.
    """

    estimator: Literal["moments", "paper", "likelihood"] = "moments"
    beta: Annotated[float, Field(ge=0, lt=1)] = 0.5  # of the paper's estimator: β₁, the mean's
