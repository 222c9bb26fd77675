"""Kinds of motion models, found by their place, and models of plain parameters."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pipeline.models
from pipeline.core.errors import ContractError, ModelDomainError

if TYPE_CHECKING:
    from pipeline.models.model import MotionModel

NO_MODEL = "reason"  # key in place of parameters: reason for a failed fit


def kinds() -> list[str]:
    """Names of all kinds."""
    places = (Path(place) for place in pipeline.models.__path__)
    return sorted(file.parent.name for place in places for file in place.glob("*/law.py"))


def build_model(parameters: Any) -> MotionModel:
    """Build a model from ``parameters``: its kind and the plain values that a fit wrote. Raises
    ContractError for anything else, ModelDomainError for values outside the model's range, and
    ModelDomainError with the reason if the fit failed.
    """
    why, kind = "", parameters.get("kind") if isinstance(parameters, dict) else None
    if kind in kinds():
        if NO_MODEL in parameters:
            raise ModelDomainError(str(parameters[NO_MODEL]))
        try:
            return import_module(f"pipeline.models.{kind}.law").build(parameters)
        except (KeyError, TypeError, ValueError) as error:
            why = f" ({error!r})"
    raise ContractError(f"not the parameters of a motion model{why}")
