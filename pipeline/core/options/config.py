"""The whole configuration: what may stand in params.yaml and pipeline/conf, section by section."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING

from pipeline.core.options.analysis import Articulation, Filter, Scale, Simulation, Wrench
from pipeline.core.options.compute import Compute
from pipeline.core.options.dataset import Dataset


@dataclass
class Config:
    seed: int = MISSING
    dataset: Dataset = field(default_factory=Dataset)
    models: dict[str, Any] = field(default_factory=dict)
    filter: Filter = field(default_factory=Filter)
    articulation: Articulation = field(default_factory=Articulation)
    wrench: Wrench = field(default_factory=Wrench)
    simulation: Simulation = field(default_factory=Simulation)
    scale: Scale = field(default_factory=Scale)
    compute: Compute = field(default_factory=Compute)
