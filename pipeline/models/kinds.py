"""Kinds of motion models: every folder of this package with a ``law.py`` is one kind.

A folder holds ``law.py`` with ``build(parameters)``, which returns a
:class:`pipeline.models.model.MotionModel`, and ``fit.py`` with ``Options``, the type of its option
file, ``estimate(recorded, options)``, ``truths(recorded, options, dispersions)`` and optionally
``estimator_options(options)`` and ``diagnose(…)``. A kind is imported when it is first needed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from pipeline.core.errors import ConfigError, ContractError, ModelDomainError
from pipeline.core.sources import ANYWHERE, imported_sources
from pipeline.models.build import build_model, kinds

if TYPE_CHECKING:
    from numpy.random import Generator
    from pandas import DataFrame

    from pipeline.models.model import MotionModel
    from pipeline.models.steps import Estimate, Options, Recorded, Truth


def sources(kind: str) -> list[Path]:
    """Files by which a model of ``kind`` is built and fitted."""
    return imported_sources([f"pipeline.models.{kind}.{name}" for name in ("law", "fit")], ANYWHERE)


def _fit(kind: str) -> ModuleType:
    return import_module(f"pipeline.models.{kind}.fit")


def options_type(kind: object) -> type[Options]:
    """Type of the options of a model of ``kind``; raises ConfigError for an unknown kind."""
    if kind not in kinds():
        raise ConfigError(f"kind: no kind {kind!r}; there are {', '.join(kinds())}", key="kind")
    return _fit(kind).Options


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """Fit the model ``options`` with its estimator; raises the errors of the estimator."""
    return _fit(options.kind).estimate(recorded, options)


def estimator_options(options: Options) -> dict[str, Options]:
    """Options of all estimators that the stage fit reports, empty for a model with a single
    estimator. A key is a pattern of the estimates' names, with ``{}`` for the parameter.
    """
    return getattr(_fit(options.kind), "estimator_options", lambda _: {})(options)


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """Known parameters of the model ``options`` for simulations with about the recorded noise
    level. A model with a dispersion has one set of parameters for each of ``dispersions``.
    """
    return _fit(options.kind).truths(recorded, options, dispersions)


def diagnose(
    recorded: Recorded, options: Options, estimate: Estimate | None, checks: int, rng: Generator
) -> tuple[dict[str, float], dict[str, DataFrame]]:
    """Diagnostic metrics and tables of an ``estimate`` (None for a failed fit). ``checks`` is the
    number of convex problems that are solved as printed.
    """
    hook = getattr(_fit(options.kind), "diagnose", lambda *_: ({}, {}))
    return hook(recorded, options, estimate, checks, rng)


def fitted_model(folder: Path) -> MotionModel:
    """Build the model of ``folder/parameters.json``; raises as :func:`build_model`."""
    file = Path(folder) / "parameters.json"
    try:
        return build_model(json.loads(file.read_text()))
    except (ContractError, OSError, ValueError) as error:
        message = f"no fitted parameters ({error}); run the stage fit"
        raise ContractError(message, file=file) from None


def fitted_models(names: Iterable[str], folder: Path, stage: str) -> dict[str, MotionModel]:
    """Fitted models of ``names`` in ``folder``; prints ``stage`` and reason of a missing fit."""
    models = {}
    for name in names:
        try:
            models[name] = fitted_model(folder / name)
        except ModelDomainError as error:
            print(f"{stage}: {name} is left out: {error.message}")
    return models
