"""``python -m pipeline export MODEL [--to FILE]``: fitted model as one JSON file for planners and
filters outside the pipeline, and a Python file that reads it and needs only NumPy.
"""

import ast
import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.core.filters import CLOSED
from pipeline.models import kinds
from pipeline.models.closed_loop import FOLDER, SHARE, fit_closed_loop, mean_path
from pipeline.models.exported import FORMAT, chain_record
from pipeline.models.joint_error.choice import unconfirmed
from pipeline.models.joint_error.fit import Options as ErrorOptions
from pipeline.models.joint_error.fit import fit_joint_error, runs_of
from pipeline.models.joint_error.held_out import (
    MOVING,
    held_out,
    ranges_of_runs,
    score_runs,
)
from pipeline.models.joint_error.samples import JointRun, lags_of_logs
from pipeline.models.steps import Recorded
from pipeline.randommatrix.wishart import largest_dispersion
from pipeline.recordings.runs import runs_of_dataset
from pipeline.recordings.steps import fitted_ranges, training_steps

HERE, EXPORTS, FIT = Path(__file__).parent, Path("data/export"), Path("data/fit")
# source files of an export, in addition to the fitted parameters
SOURCES = [Path("data/config.yaml"), Path("data/track/joints.parquet")]
UNITS = {
    "joint angle": "rad, m of a prismatic joint",
    "command": "step of the task's rows in 1/rate_per_s, m and rad (angular rows times the arm's "
    "length where it has one), then of the joints where it is longer",
    "joint step": "commanded step of each joint in 1/rate_per_s, rad",
}
READER_NAME, READER = "read_motion_model.py", "pipeline.models.exported"
KINDS = "pipeline.models.kinds"
# modules whose texts in the reader are files of this folder: helpers without a compiler
STAND_INS = ("pipeline.core.compiled", "pipeline.core.elementary")


def run(model: str, to: Path | None = None) -> None:
    """Write the model and its reader; fit the model first if the last run has no fit of it."""
    settings = config.sections("export", HERE / "reads.yaml")
    record = exported_record(model, settings)
    write_export(record, to or EXPORTS / f"{settings.dataset.name}_{model}.json")


def write_export(record: dict[str, Any], file: Path) -> None:
    """Write ``record`` to ``file``, the reader into the same folder, and print how to load it."""
    reader = file.parent / READER_NAME
    contracts.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", file)
    contracts.write_text(reader_source(), reader)
    print(f"export: wrote {file} and {reader}")
    print(
        f"export: in that folder: from {reader.stem} import load; load('{file.name}')"
    )
    for each in record["not_known"]:
        print(f"export: not known: {each['parameter']}: {each['found']}")


def error_record(
    model: str,
    options: ErrorOptions,
    runs: Sequence[JointRun],
    dataset: str,
    scores: pd.DataFrame | None = None,
) -> dict[str, Any]:
    """Return the JSON record of the joint error law ``options``, fitted to all ``runs``; ``scores``
    is the table joint_scores of the runs, computed if it is None.
    """
    if scores is None:
        scores = held_out(runs, {model: options})["joint_scores"]
    law = fit_joint_error(runs, **options.law())
    noise = [run.pose_noise for run in runs if run.pose_noise]
    known = [
        {"name": run.name, "motion": run.motion, "samples": len(run.command)}
        | {"lag_s": run.lag.tolist(), "scores": scores_by_horizon(law, run)[0]}
        for run in runs
    ]
    return {
        "format": FORMAT,
        "dataset": dataset,
        "model": model,
        "joints": list(law.joints),
        "units": UNITS,
        "rate_per_s": law.rate,
        "closed_loop_share": 0.0,
        "pose_noise_rad": max(noise, default=None),
        "parameters": law.parameters(),
        "not_known": [*unconfirmed(scores, model), *unknown_lag(runs)],
        "ranges": _ranges(ranges_of_runs(runs)),
        "runs": known,
    }


def unknown_lag(runs: Sequence[JointRun]) -> list[dict[str, str]]:
    """Return an entry of ``not_known`` if all ``runs`` are of one log."""
    if len(lags_of_logs(runs)) > 1:
        return []
    found = "unknown: all runs are of one log"
    entry = {"parameter": "spread of the lag of another run", "found": found}
    return [entry | {"required": "2 logs"}]


def scores_by_horizon(law, run: JointRun) -> tuple[dict[str, float], pd.DataFrame]:
    """Return horizon → mean log score of the commanded samples of ``run`` in nats (1/rad), and the
    rows of :func:`score_runs`.
    """
    rows = pd.DataFrame(score_runs(law, [run])[0])
    rows = rows[rows["samples"] == MOVING] if len(rows) else rows
    means = {
        name: float(np.average(own["score"], weights=own["count"]))
        for name, own in (rows.groupby("horizon", sort=False) if len(rows) else ())
    }
    return means, rows


def exported_record(model: str, settings: Any) -> dict[str, Any]:
    """Return the JSON record of ``model``. A joint error law is fitted to all runs of the dataset.
    A model of the last run, or its closed-loop form, is read from the run. Any other option of
    pipeline/conf/model is fitted to the training takes.

    Raises ConfigError for an unknown model, and ModelDomainError where the recordings determine no
    model or not all parameters that its predictions need.
    """
    name, dataset, sources = model.removesuffix(CLOSED), settings.dataset, SOURCES
    options = config.model_options([name])[name]
    recorded = training_steps(dataset.robot, dataset.motion)
    if isinstance(options, ErrorOptions):
        runs = runs_of_dataset(dataset).runs if dataset.joint_log else runs_of(recorded)
        record, takes = error_record(model, options, runs, dataset.name), len(runs)
    else:
        record = {
            "format": FORMAT,
            "dataset": dataset.name,
            "model": model,
            "joints": list(dataset.robot.joints),
            "task": list(recorded.chain.task),
            "units": UNITS,
            "rate_per_s": dataset.motion.rate,
            "closed_loop_share": 0.0,
            "pose_covariance_rad2": None,
            "arm": chain_record(recorded.chain),
        }
        with suppress(ModelDomainError):  # the noise of a measured pose is not known
            record["pose_covariance_rad2"] = (
                recorded.measurement / 2
            ).tolist()  # half a step's
        file = FIT / name / (FOLDER if model != name else "") / "parameters.json"
        if name in settings.models and file.is_file():
            fitted = _read(file), _read(FIT / name / "fit.json")
            sources = [*SOURCES, file]
        else:
            fitted = _fit(recorded, options, closed_form=model != name)
        record |= _fitted_part(model, *fitted, recorded, dataset.motion.rate)
        takes = len(recorded.q)
    digests = [hashlib.sha256(file.read_bytes()).digest() for file in sources]
    run = {
        "sha256": hashlib.sha256(b"".join(digests)).hexdigest(),
        "sources": [file.as_posix() for file in sources],
        "seed": settings.seed,
        "scale": settings.scale.name,
        "takes": takes,
    }
    return record | {"takes": takes, "run": run}


def _ranges(rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Return quantity → name → unit, least and greatest value, from a table of ranges."""
    return {
        quantity: own.set_index("name")[["unit", "least", "greatest"]].to_dict("index")
        for quantity, own in rows.groupby("quantity", sort=False)
        if quantity in ("pose", "speed", "joint speed", "error")
    }


def _fit(
    recorded: Recorded, options: Any, closed_form: bool
) -> tuple[dict[str, Any], ...]:
    """Return parameters and estimates of a model that the last run has no fit of."""
    fit = kinds.estimate(recorded, options)
    if not closed_form:
        return fit.parameters, fit.determined
    closed = fit_closed_loop(recorded, options, fit)
    estimates = {
        f"closed_loop_{key}": v for key, v in closed.estimate.determined.items()
    }
    return closed.estimate.parameters | {SHARE: closed.share}, estimates


def _fitted_part(
    model: str,
    parameters: dict[str, Any],
    estimates: dict[str, Any],
    recorded: Recorded,
    rate: float,
) -> dict[str, Any]:
    """Return the part of the record that the fit determines; ``rate`` in Hz."""
    if kinds.NO_MODEL in parameters:
        raise ModelDomainError(
            f"no model to export: {parameters[kinds.NO_MODEL]}", model=model
        )
    require_known(model, parameters, recorded)
    share, not_known = parameters.get(SHARE, 0.0), []
    if parameters.get("u_unbounded"):  # only the noise level is known, not α and u
        level = estimates["closed_loop_" * model.endswith(CLOSED) + "noise_level"]
        shared = {key: v for key, v in parameters.items() if key == SHARE}
        parameters = {"kind": parameters["kind"], "level": level} | shared
        found = "u at the end of its search"
        required = "a greatest likelihood or least error at a finite u"
        not_known = [
            {"parameter": "alpha and u apart", "found": found, "required": required}
        ]
    if share > 0:  # ranges apply to the commands after the closed-loop correction
        v = mean_path(recorded).corrected_commands(recorded.q, share)
        noise = (
            recorded.q_next - recorded.q - recorded.chain.nominal_step(recorded.q, v)
        )
        recorded = replace(recorded, v=v, noise=noise)
    return {
        "parameters": parameters,
        "not_known": not_known,
        "closed_loop_share": share,
        "ranges": _ranges(fitted_ranges(recorded, rate)),
    }


def require_known(model: str, parameters: dict[str, Any], recorded: Recorded) -> None:
    """Raise ModelDomainError for a Wishart model without a covariance."""
    limit = largest_dispersion(len(recorded.chain.task), inverse_moments=2)
    if (
        parameters["kind"] == "wishart"
        and (sigma_b := parameters.get("sigma_b", 0.0)) >= limit
    ):
        raise ModelDomainError(
            f"{model}: sigma_b {sigma_b:.3g} is not below {limit:.3g}, where a step has a "
            "covariance; the recordings give no Wishart model to predict with"
        )


def _read(file: Path) -> dict[str, Any]:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContractError(
            f"cannot be read ({error}); run the stage fit", file=file
        ) from None


def reader_source() -> str:
    """Return the text of READER_NAME: reader.txt with the project's reader, its laws and the
    modules that they import, each of which stays a module with names of its own.
    """
    laws = {kind: f"pipeline.models.{kind}.law" for kind in kinds.kinds()}
    texts = {name: _stand_in(name) for name in STAND_INS}
    texts[KINDS] = "".join(
        f"from {module} import build as build_{kind}\n" for kind, module in laws.items()
    )
    texts[KINDS] += _stand_in(KINDS).replace(
        "LAWS", ", ".join(f'"{kind}": build_{kind}' for kind in laws)
    )
    waiting = [*laws.values(), READER]
    while waiting:
        if (name := waiting.pop()) not in texts:
            texts[name] = Path(find_spec(name).origin).read_text(encoding="utf-8")
            waiting += imported_modules(texts[name])
    modules = "".join(f"    {name!r}: {_quoted(texts[name])},\n" for name in texts)
    template = (HERE / "reader.txt").read_text(encoding="utf-8")
    return template.replace("MODULES = {}", f"MODULES = {{\n{modules}}}")


def imported_modules(text: str) -> list[str]:
    """Return the modules of the pipeline that the module of this ``text`` imports at its top."""
    names = []
    for statement in ast.parse(text).body:
        if isinstance(statement, ast.ImportFrom):
            source = statement.module or ""
            if source.partition(".")[0] == "pipeline":
                names.append(source)
    return names


def _stand_in(module: str) -> str:
    """Return the text that replaces ``module`` in the reader."""
    file = HERE / f"{module.rpartition('.')[2]}.txt"
    return file.read_text(encoding="utf-8")


def _quoted(text: str) -> str:
    """Return ``text`` as a literal of Python that a person can read."""
    plain = "'''" not in text and not text.endswith(("\\", "'"))
    return f"r'''{text}'''" if plain else repr(text)
