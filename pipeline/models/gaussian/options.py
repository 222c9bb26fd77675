"""Options of the Gaussian matrix model."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.models import options

ESTIMATORS = ("moments", "paper", "likelihood")


@dataclass
class Options(options.Options):
    """``estimator``: ``moments`` (the recorded total variance, then its course over time),
    ``paper`` (the distance of one-step moments, step by step) or ``likelihood``.
    """

    estimator: str = "moments"
    beta: float = 0.5  # of the paper's estimator alone: β₁, weight of the mean's error

    def __post_init__(self) -> None:
        options.require_choice("estimator", self.estimator, ESTIMATORS)
