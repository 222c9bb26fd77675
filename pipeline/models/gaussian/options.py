"""Options of the Gaussian matrix model."""

from __future__ import annotations

from dataclasses import dataclass

from omegaconf import MISSING

from pipeline.core.errors import ConfigError
from pipeline.models import options


@dataclass
class Options(options.Options):
    """``estimator``: ``paper`` or ``likelihood``."""

    estimator: str = MISSING
    beta: float | None = None  # of the paper's estimator alone

    def __post_init__(self) -> None:
        options.require_choice("estimator", self.estimator, ("paper", "likelihood"))
        if self.estimator == "paper" and self.beta is None:
            raise ConfigError(
                "the paper's estimator of a Gaussian model needs a beta", key="models.*.beta"
            )
