"""Options of the model whose noise grows with the joint speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from omegaconf import MISSING

from pipeline.models import options

Structure = Literal["diagonal", "full"]


@dataclass
class Options(options.Options):
    """``structure`` of the covariances: ``diagonal`` or ``full``."""

    structure: str = MISSING

    def __post_init__(self) -> None:
        options.require_choice("structure", self.structure, get_args(Structure))
