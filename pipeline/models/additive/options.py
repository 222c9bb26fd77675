"""Options of the additive model."""

from __future__ import annotations

from dataclasses import dataclass

from omegaconf import MISSING

from pipeline.models import options


@dataclass
class Options(options.Options):
    """``estimator``: ``paper`` or ``shrinkage``."""

    estimator: str = MISSING

    def __post_init__(self) -> None:
        options.require_choice("estimator", self.estimator, ("paper", "shrinkage"))
