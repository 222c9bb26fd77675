"""``python -m pipeline export MODEL [--to FILE]``: fitted model as one JSON file for planners and
filters outside the pipeline, and a Python file that reads it and needs only NumPy.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.configuration import config
from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.core.filters import CLOSED
from pipeline.models import kinds
from pipeline.models.closed_loop import FOLDER, SHARE, fit_closed_loop, mean_path
from pipeline.models.exported.writer import error_record, step_record, write_export
from pipeline.models.joint_error.fit import Options as ErrorOptions
from pipeline.models.joint_error.fit import runs_of
from pipeline.models.steps import Recorded
from pipeline.recordings.runs import runs_of_dataset
from pipeline.recordings.steps import fitted_ranges, training_steps

HERE = Path(__file__).parent
EXPORTS = Path("data/export")
FIT = Path("data/fit")
# source files of an export, in addition to the fitted parameters
SOURCES = [Path("data/config.yaml"), Path("data/track/joints.parquet")]


def run(model: str, to: Path | None = None) -> None:
    """Write the model and its reader; fit the model first if the last run has no fit of it."""
    settings = config.sections("export", HERE / "reads.yaml")
    record = exported_record(model, settings)
    write_export(record, to or EXPORTS / f"{settings.dataset.name}_{model}.json")


def exported_record(model: str, settings: Any) -> dict[str, Any]:
    """Return the JSON record of ``model``. A joint error law is fitted to all runs of the dataset.
    A model of the last run, or its closed-loop form, is read from the run. Any other option of
    pipeline/conf/model is fitted to the training takes.

    Raises ConfigError for an unknown model, and ModelDomainError where the recordings determine no
    model or not all parameters that its predictions need.
    """
    name = model.removesuffix(CLOSED)
    dataset = settings.dataset
    options = config.model_options([name])[name]
    recorded = training_steps(dataset.robot, dataset.motion)
    if isinstance(options, ErrorOptions):
        runs = runs_of_dataset(dataset).runs if dataset.joint_log else runs_of(recorded)
        record = error_record(model, options, runs, dataset.name)
        return record | _origin(SOURCES, settings, len(runs))

    folder = FIT / name
    file = folder / (FOLDER if model != name else "") / "parameters.json"
    if name in settings.models and file.is_file():
        sources = [*SOURCES, file]
        parameters = _read(file)
        estimates = _read(folder / "fit.json")
    else:
        sources = SOURCES
        parameters, estimates = _fit(recorded, options, closed_loop=model != name)
    record = _step_record(model, parameters, estimates, recorded, dataset)
    return record | _origin(sources, settings, len(recorded.q))


def _origin(sources: Sequence[Path], settings: Any, takes: int) -> dict[str, Any]:
    """Return the number of takes, and the run and files that a record was made of."""
    digests = [hashlib.sha256(file.read_bytes()).digest() for file in sources]
    run = {
        "sha256": hashlib.sha256(b"".join(digests)).hexdigest(),
        "sources": [file.as_posix() for file in sources],
        "seed": settings.seed,
        "scale": settings.scale.name,
        "takes": takes,
    }
    return {"takes": takes, "run": run}


def _fit(
    recorded: Recorded,
    options: Any,
    closed_loop: bool,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return parameters and estimates of a model that the last run has no fit of."""
    fit = kinds.estimate(recorded, options)
    if not closed_loop:
        return fit.parameters, fit.determined
    closed = fit_closed_loop(recorded, options, fit)
    determined = closed.estimate.determined
    estimates = {f"closed_loop_{key}": value for key, value in determined.items()}
    return closed.estimate.parameters | {SHARE: closed.share}, estimates


def _step_record(
    model: str,
    parameters: dict[str, Any],
    estimates: dict[str, Any],
    recorded: Recorded,
    dataset: Any,
) -> dict[str, Any]:
    """Return the record of a law of steps with the fitted ``parameters`` and ``estimates``; raises
    ModelDomainError if the fit failed.
    """
    if kinds.NO_MODEL in parameters:
        reason = parameters[kinds.NO_MODEL]
        raise ModelDomainError(f"no model to export: {reason}", model=model)
    not_known = []
    if parameters.get("u_unbounded"):
        parameters = _level_alone(model, parameters, estimates)
        not_known.append(
            {
                "parameter": "alpha and u apart",
                "found": "u at the end of its search",
                "required": "a greatest likelihood or least error at a finite u",
            },
        )
    commanded = _with_corrected_commands(recorded, parameters.get(SHARE, 0.0))
    ranges = fitted_ranges(commanded, dataset.motion.rate)
    recorded = replace(recorded, rate=dataset.motion.rate)
    return step_record(model, dataset.name, recorded, parameters, not_known, ranges)


def _level_alone(
    model: str,
    parameters: dict[str, Any],
    estimates: dict[str, Any],
) -> dict[str, Any]:
    """Return the parameters of a Gaussian model whose noise level is known, but not α and u."""
    prefix = "closed_loop_" if model.endswith(CLOSED) else ""
    level = {"kind": parameters["kind"], "level": estimates[f"{prefix}noise_level"]}
    if SHARE in parameters:
        level[SHARE] = parameters[SHARE]
    return level


def _with_corrected_commands(recorded: Recorded, share: float) -> Recorded:
    """Return ``recorded`` with the commands after the correction of a closed loop with ``share`` κ,
    to which the ranges of its model apply.
    """
    if share == 0:
        return recorded
    v = mean_path(recorded).corrected_commands(recorded.q, share)
    nominal = recorded.chain.nominal_step(recorded.q, v)
    return replace(recorded, v=v, noise=recorded.q_next - recorded.q - nominal)


def _read(file: Path) -> dict[str, Any]:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        message = f"cannot be read ({error}); run the stage fit"
        raise ContractError(message, file=file) from None
