"""``python -m pipeline export MODEL [--to FILE]``: fitted model in one file for planners and
filters outside the pipeline, and one Python file that reads it with NumPy alone.
"""

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.arm.model import chain_of
from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError, ContractError, ModelDomainError
from pipeline.core.filters import CLOSED
from pipeline.models import kinds
from pipeline.models.closed_loop import FOLDER, SHARE, fit_closed_loop, mean_path
from pipeline.models.exported import FORMAT, chain_record
from pipeline.models.joint_steps import LEAST_SHARE, PLAIN, fit_joint_steps
from pipeline.models.other_motions import UNTOLD, MotionSteps, all_steps, joint_ranges, motion_of
from pipeline.models.steps import Recorded
from pipeline.randommatrix.wishart import largest_dispersion
from pipeline.recordings.motions import logged_motions
from pipeline.recordings.steps import fitted_ranges, training_steps
from pipeline.tools.export.reader_file import NAME, reader_source

HERE, EXPORTS = Path(__file__).parent, Path("data/export")
FIT = Path("data/fit")
# sources of a run's numbers, the fitted parameters beside
SOURCES = [Path("data/config.yaml"), Path("data/track/joints.parquet")]
UNITS = {
    "joint angle": "rad, m of a prismatic joint",
    "command": "step of the task's rows in 1/rate_per_s, m and rad (angular rows times the arm's "
    "length where it has one), then of the joints where it is longer",
    "joint step": "commanded step of each joint in 1/rate_per_s, rad",
}
MODEL = (
    f"{', '.join(PLAIN)}: fitted to all motions; or an option of pipeline/conf/model, "
    "MODEL_closed for its closed-loop form"
)
TO = f"output file (default {EXPORTS}/DATASET_MODEL.json)"
ARGUMENTS = {
    "model": {"metavar": "MODEL", "help": MODEL},
    "--to": {"type": Path, "metavar": "FILE", "help": TO},
}


def run(model: str, to: Path | None = None) -> None:
    """Write the model, fitted here where the last run has no fit of it, and its reader."""
    settings = config.sections("export", HERE / "reads.yaml")
    record = exported(model, settings)
    write_export(record, to or EXPORTS / f"{settings.dataset.name}_{model}.json")


def write_export(record: dict[str, Any], file: Path) -> None:
    """Write ``record`` to ``file`` and the reader beside it, and say how it is loaded."""
    contracts.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", file)
    contracts.write_text(reader_source(), file.parent / NAME)
    print(f"export: wrote {file} and {file.parent / NAME}")
    print(f"export: in that folder: from {Path(NAME).stem} import load; load('{file.name}')")
    for each in record["not_known"]:
        of = f" of {each['joint']}" if each.get("joint") else ""
        print(f"export: no number for {each['parameter']}{of}: {each['found']}")


def require_name(model: str) -> None:
    """Raise ConfigError where no model has this name."""
    options = config.option_names("model")
    if model not in PLAIN and model.removesuffix(CLOSED) not in options:
        there_are = ", ".join([*PLAIN, *options])
        raise ConfigError(f"no model {model!r}; there are {there_are}", key="MODEL")


def exported(
    model: str, settings: Any, motions: Sequence[MotionSteps] | None = None
) -> dict[str, Any]:
    """Return the record of ``model``: a plain model, fitted here to all motions of the logs or to
    ``motions``; a model of the run or its closed-loop form; or any other option of
    pipeline/conf/model, fitted here to the training takes.

    Raises ConfigError for an unknown model, and ModelDomainError where the recordings give none or
    cannot tell a parameter that its predictions need.
    """
    require_name(model)
    dataset, sources = settings.dataset, SOURCES
    chain, motion = chain_of(dataset.robot), dataset.motion
    record = {
        "format": FORMAT,
        "dataset": dataset.name,
        "model": model,
        "joints": list(dataset.robot.joints),
        "task": list(chain.task),
        "units": UNITS,
        "rate_per_s": motion.rate,
        "closed_loop_share": 0.0,
        "covariance_of_estimates": None,
        "pose_covariance_rad2": None,
        "arm": chain_record(chain),
    }
    if motions is None or model not in PLAIN:
        recorded = training_steps(dataset.robot, motion)
        with suppress(ModelDomainError):  # the noise of a measured pose is not known
            record["pose_covariance_rad2"] = (recorded.measurement / 2).tolist()  # half a step's
    if model in PLAIN:
        if motions is None:
            motions = (dataset.joint_log and logged_motions(dataset)) or [motion_of(recorded)]
        else:
            sources = SOURCES[:1]
        record |= _plain(model, motions, dataset)
    else:
        own, sources = _fitted(model, settings, recorded)
        record |= own | {"takes": len(recorded.q)}
    each = [hashlib.sha256(file.read_bytes()).digest() for file in sources]
    record["run"] = {
        "sha256": hashlib.sha256(b"".join(each)).hexdigest(),
        "sources": [file.as_posix() for file in sources],
        "seed": settings.seed,
        "scale": settings.scale.name,
        "takes": record["takes"],
    }
    return record


def _plain(model: str, motions: Sequence[MotionSteps], dataset: Any) -> dict[str, Any]:
    joints, motion = tuple(dataset.robot.joints), dataset.motion
    fit = fit_joint_steps(model, *all_steps(motions), joints, pose_noise=motion.pose_noise or 0.0)
    return {
        "parameters": fit.model.parameters(),
        "estimates": {},
        "not_known": [dict(zip(UNTOLD, row, strict=True)) for row in fit.untold],
        "ranges": _ranges(joint_ranges(motions, joints, motion.rate)),
        "motions": len(motions),
        "takes": sum(len(one.q) for one in motions),
    }


def _ranges(rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Ends and unit by name, for each quantity of a table of ranges that a model warns by."""
    return {
        quantity: own.set_index("name")[["unit", "least", "greatest"]].to_dict("index")
        for quantity, own in rows.groupby("quantity", sort=False)
        if quantity in ("pose", "speed", "joint speed")
    }


def _fitted(model: str, settings: Any, recorded: Recorded) -> tuple[dict[str, Any], list[Path]]:
    """Part of the record that the stage fit, or a fit here, decides; and its sources."""
    name = model.removesuffix(CLOSED)
    closed_form, not_known, covariance, sources = model != name, [], None, SOURCES
    file = FIT / name / (FOLDER if closed_form else "") / "parameters.json"
    if name in settings.models and file.is_file():
        parameters, metrics, sources = _read(file), _read(FIT / name / "fit.json"), [*SOURCES, file]
        names = [key for key in metrics if key.startswith("closed_loop_")]
        if not closed_form:
            covariance = _read(FIT / name / "covariance.json")
            ends = ("", "_standard_error", "_interval_low", "_interval_high")
            names = [f"{key}{end}" for key in covariance["estimates"] for end in ends]
            names.append("u_unbounded")
        estimates = {key: metrics[key] for key in names if key in metrics}
    else:
        options = config.model_options([name])[name]
        found = kinds.estimate(recorded, options)
        parameters, estimates = found.parameters, found.estimates
        if closed_form:
            closed = fit_closed_loop(recorded, options, found)
            parameters = closed.estimate.parameters | {SHARE: closed.share}
            own = closed.estimate.estimates.items()
            estimates = {f"closed_loop_{key}": value for key, value in own}
        elif "u_unbounded" in found.diagnostics:
            estimates = estimates | {"u_unbounded": found.diagnostics["u_unbounded"]}
    if kinds.NO_MODEL in parameters:
        raise ModelDomainError(f"no model to export: {parameters[kinds.NO_MODEL]}", model=model)
    require_told(model, parameters, recorded)
    share = parameters.get(SHARE, 0.0)
    if parameters["kind"] == "gaussian" and estimates.get("u_unbounded"):
        # the level alone is known: α and u apart have no number
        level = {"kind": "gaussian", "level": parameters["alpha"] * parameters["u"]}
        parameters = level | {key: v for key, v in parameters.items() if key == SHARE}
        unknown = [k for k in estimates if k.split("_")[0] in ("alpha", "u") or "_alpha" in k]
        estimates = {key: value for key, value in estimates.items() if key not in unknown}
        covariance, found = None, "u at the end of its search"
        required = "a greatest likelihood or least error at a finite u"
        not_known = [{"parameter": "alpha and u apart", "found": found, "required": required}]
    if share > 0:  # the ranges of the commands that the closed loop has corrected
        v = mean_path(recorded).corrected_commands(recorded.q, share)
        noise = recorded.q_next - recorded.q - recorded.chain.nominal_step(recorded.q, v)
        recorded = replace(recorded, v=v, noise=noise)
    return {
        "parameters": parameters,
        "estimates": estimates,
        "not_known": not_known,
        "covariance_of_estimates": covariance,
        "closed_loop_share": share,
        "ranges": _ranges(fitted_ranges(recorded, settings.dataset.motion.rate)),
    }, sources


def require_told(model: str, parameters: dict[str, Any], recorded: Recorded) -> None:
    """Raise ModelDomainError where the steps of ``recorded`` cannot tell a gain that grows with the
    speed of a joint, as the joint hardly moved, and for a Wishart model without a covariance.
    """
    if parameters["kind"] == "scaled":
        most = np.abs(recorded.chain.nominal_step(recorded.q, recorded.v)).max(axis=(0, 1))
        least, steps = LEAST_SHARE * most.max(), zip(recorded.joints, most, strict=True)
        still = [
            f"{joint} (at most {step:.2g} rad a step)" for joint, step in steps if step < least
        ]
        if still:
            raise ModelDomainError(
                f"{model}: the recordings cannot tell how noise grows with the speed of "
                f"{', '.join(still)}, where {least:.2g} rad is required; export scaled_all or "
                "distance_t, which all motions are fitted to, or record a motion in which they move"
            )
    limit = largest_dispersion(len(recorded.chain.task), inverse_moments=2)
    if parameters["kind"] == "wishart" and (sigma_b := parameters.get("sigma_b", 0.0)) >= limit:
        raise ModelDomainError(
            f"{model}: sigma_b {sigma_b:.3g} is not below {limit:.3g}, where a step has a "
            "covariance; the recordings give no Wishart model to predict with"
        )


def _read(file: Path) -> dict[str, Any]:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContractError(f"cannot be read ({error}); run the stage fit", file=file) from None
