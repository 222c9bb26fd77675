"""The kinds of motion models: each is a folder of this package, found by its place.

A folder holds ``options.py`` with ``Options``, the type of its option file; ``law.py`` with the
model's class and ``build(parameters)``; and ``fit.py`` with ``estimate(recorded, options)`` and
``truths(recorded, options, dispersions)``, and ``compared(options)`` where the stage fit estimates
its parameters in several ways; ``examination.py``, where there is one, adds tables and numbers that
are no parameters. Nothing of a kind is imported before it is needed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pipeline.models
from pipeline.core.errors import ConfigError, ContractError, ModelDomainError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from pipeline.models.model import MotionModel
    from pipeline.models.options import Options
    from pipeline.models.steps import Estimate, Recorded, Truth


NO_MODEL = "reason"  # in place of parameters: why the recordings give none


def kinds() -> list[str]:
    """The names of all kinds."""
    return sorted(
        file.parent.name
        for place in pipeline.models.__path__
        for file in Path(place).glob("*/options.py")
    )


def options_type(kind: object) -> type[Options]:
    """The type of the options of a model of ``kind``; raises ConfigError for no kind that there
    is.
    """
    if kind not in kinds():
        raise ConfigError(f"kind: no kind {kind!r}; there are {', '.join(kinds())}", key="kind")
    return import_module(f"pipeline.models.{kind}.options").Options


def _fit(kind: str) -> ModuleType:
    return import_module(f"pipeline.models.{kind}.fit")


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """The parameters of the model ``options`` by the estimator they name; raises what that
    estimator raises.
    """
    return _fit(options.kind).estimate(recorded, options)


def compared(options: Options) -> dict[str, Options]:
    """Options of the estimates that the stage fit writes beside the chosen one, by the pattern of
    their names, ``{}`` standing for the parameter: every estimator of a matrix model, and of the
    Wishart model the control decomposition.
    """
    hook = getattr(_fit(options.kind), "compared", None)
    return {} if hook is None else hook(options)


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """Known parameters of the model ``options`` with noise of about the size that was recorded;
    where a model has a dispersion, each of ``dispersions``.
    """
    return _fit(options.kind).truths(recorded, options, dispersions)


def build_model(parameters: Any) -> MotionModel:
    """The model with these ``parameters``: its kind and, in plain values, what a fit found.

    Raises ContractError where they are none of a motion model, ModelDomainError where they are
    outside the model's range, and, with its reason, where the fit found no model.
    """
    kind = parameters.get("kind") if isinstance(parameters, dict) else None
    if kind not in kinds():
        raise ContractError("not the parameters of a motion model; run the stage fit again")
    if NO_MODEL in parameters:
        raise ModelDomainError(str(parameters[NO_MODEL]))
    try:
        return import_module(f"pipeline.models.{kind}.law").build(parameters)
    except (KeyError, TypeError, ValueError) as error:
        raise ContractError(
            f"not the parameters of a motion model ({error!r}); run the stage fit again"
        ) from None


def fitted_model(folder: Path) -> MotionModel:
    """The model whose parameters stand in ``folder/parameters.json``; raises what
    :func:`build_model` does, with the file.
    """
    file = Path(folder) / "parameters.json"
    try:
        parameters = json.loads(file.read_text())
    except (OSError, ValueError) as error:
        raise ContractError(
            f"the fitted parameters cannot be read ({error}); run the stage fit", file=file
        ) from None
    try:
        return build_model(parameters)
    except ContractError as error:
        raise ContractError(error.message, file=file) from None


def fitted_models(names: Iterable[str], folder: Path, stage: str) -> dict[str, MotionModel]:
    """The models of these ``names`` in ``folder``; one without a fit is left out, and its reason
    printed as a line of the ``stage``.
    """
    models = {}
    for name in names:
        try:
            models[name] = fitted_model(folder / name)
        except ModelDomainError as error:
            print(f"{stage}: {name} is left out: {error.message}")
    return models


def examined(
    recorded: Recorded,
    options: Options,
    estimate: Estimate | None,
    checks: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, pd.DataFrame]]:
    """Numbers and tables beside an ``estimate``, by the kind's ``examination.py`` where it has one.

    Args:
        recorded: the steps that were fitted.
        options: of the model.
        estimate: from all takes; None where they give none.
        checks: how many convex problems to solve as printed, where there are any.
        rng: chooses them.
    """
    kind = f"pipeline.models.{options.kind}"
    if find_spec(f"{kind}.examination") is None:
        return {}, {}
    return import_module(f"{kind}.examination").examined(recorded, options, estimate, checks, rng)
