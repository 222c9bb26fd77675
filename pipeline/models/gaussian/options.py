"""Options of the Gaussian matrix model."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

from pipeline.core import validation
from pipeline.models import options

Estimator = Literal["moments", "paper", "likelihood"]
ESTIMATORS = get_args(Estimator)


@validation.options(kw_only=True)
class Options(options.Options):
    """``estimator``: ``moments`` (the recorded total variance, then its course over time),
    ``paper`` (the distance of one-step moments, step by step) or ``likelihood``.
    """

    estimator: Estimator = "moments"
    # of the paper's estimator alone: β₁, weight of the mean's error
    beta: Annotated[float, Field(ge=0, lt=1)] = 0.5
