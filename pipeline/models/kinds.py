"""Kinds of motion models: every folder of this package with a ``law.py`` is one kind.

A folder holds ``law.py`` with ``build(parameters)``, which returns a
:class:`pipeline.models.model.MotionModel`, and ``fit.py`` with ``Options``, the type of its option
file, ``estimate(recorded, options)``, ``truths(recorded, options, dispersions)`` and optionally
``estimator_options(options)`` and ``diagnose(…)``. A kind is imported when it is first needed. The
arguments ``recorded`` and ``options`` and the results are of the types of
:mod:`pipeline.models.steps`, which imports this module.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pipeline.models
from pipeline.core.errors import ConfigError, ContractError, ModelDomainError
from pipeline.core.sources import ANYWHERE, imported_sources

if TYPE_CHECKING:
    from pipeline.models.model import MotionModel

NO_MODEL = "reason"  # key in place of parameters: reason for a failed fit


def kinds() -> list[str]:
    """Names of all kinds."""
    places = (Path(place) for place in pipeline.models.__path__)
    return sorted(
        file.parent.name for place in places for file in place.glob("*/law.py")
    )


def sources(kind: str) -> list[Path]:
    """Files by which a model of ``kind`` is built and fitted."""
    return imported_sources(
        [f"pipeline.models.{kind}.{name}" for name in ("law", "fit")],
        ANYWHERE,
    )


def _fit(kind: str) -> Any:
    return import_module(f"pipeline.models.{kind}.fit")


def options_type(kind: object) -> type:
    """Type of the options of a model of ``kind``; raises ConfigError for an unknown kind."""
    if kind not in kinds():
        raise ConfigError(
            f"kind: no kind {kind!r}; there are {', '.join(kinds())}",
            key="kind",
        )
    return _fit(kind).Options


def estimate(recorded, options):
    """Estimate of the model ``options``; raises the errors of the estimator."""
    return _fit(options.kind).estimate(recorded, options)


def estimator_options(options) -> dict[str, Any]:
    """Options of all estimators that the stage fit reports, empty for a model with a single
    estimator. A key is a pattern of the estimates' names, with ``{}`` for the parameter.
    """
    return getattr(_fit(options.kind), "estimator_options", lambda _: {})(options)


def truths(recorded, options, dispersions: Sequence[float]) -> list:
    """Known parameters of the model ``options`` for simulations with about the recorded noise
    level. A model with a dispersion has one set of parameters for each of ``dispersions``.
    """
    return _fit(options.kind).truths(recorded, options, dispersions)


def diagnose(recorded, options, estimate, checks: int, rng) -> tuple[dict, dict]:
    """Diagnostic metrics and tables of an ``estimate`` (None for a failed fit). ``checks`` is the
    number of convex problems that are solved as printed.
    """
    hook = getattr(_fit(options.kind), "diagnose", lambda *_: ({}, {}))
    return hook(recorded, options, estimate, checks, rng)


def build_model(parameters: Any) -> MotionModel:
    """Build a model from ``parameters``: its kind and the plain values that a fit wrote. Raises
    ContractError for anything else, ModelDomainError for values outside the model's range, and
    ModelDomainError with the reason if the fit failed.
    """
    why = ""
    kind = parameters.get("kind") if isinstance(parameters, dict) else None
    if kind in kinds():
        if NO_MODEL in parameters:
            raise ModelDomainError(str(parameters[NO_MODEL]))
        try:
            return import_module(f"pipeline.models.{kind}.law").build(parameters)
        except (KeyError, TypeError, ValueError) as error:
            why = f" ({error!r})"
    raise ContractError(f"not the parameters of a motion model of kind {kind!r}{why}")


def fitted_model(folder: Path) -> MotionModel:
    """Build the model of ``folder/parameters.json``; raises as :func:`build_model`."""
    file = Path(folder) / "parameters.json"
    try:
        return build_model(json.loads(file.read_text()))
    except (ContractError, OSError, ValueError) as error:
        message = f"no fitted parameters ({error}); run the stage fit"
        raise ContractError(message, file=file) from None


def fitted_models(
    names: Iterable[str],
    folder: Path,
    stage: str,
) -> dict[str, MotionModel]:
    """Fitted models of ``names`` in ``folder``; prints ``stage`` and reason of a missing fit."""
    models = {}
    for name in names:
        try:
            models[name] = fitted_model(folder / name)
        except ModelDomainError as error:
            print(f"{stage}: {name} is left out: {error.message}")
    return models
