"""What an exported model's file holds: parameters and how sure they are, the arm, the ranges of the
takes it was fitted to, and the run that it comes from.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from pipeline.core.errors import ConfigError, ContractError, ModelDomainError
from pipeline.core.filters import CLOSED, closed
from pipeline.models.closed_loop import FOLDER, SHARE, mean_path
from pipeline.models.exported import FORMAT, chain_record
from pipeline.models.kinds import NO_MODEL
from pipeline.models.steps import Recorded
from pipeline.recordings.steps import fitted_ranges, training_steps

FIT = Path("data/fit")
# what a run's numbers come from, the fitted parameters beside
SOURCES = (Path("data/config.yaml"), Path("data/track/joints.parquet"))
UNITS = {
    "joint angle": "rad, m of a prismatic joint",
    "command": "step of the task's rows in 1/rate_per_s, m and rad (angular rows times the arm's "
    "length where it has one), then of the joints where it is longer",
}


def exported(model: str, settings: SimpleNamespace) -> dict[str, Any]:
    """The record of ``model``, one of ``settings.models`` or its closed-loop form.

    Raises ConfigError for a model that the run does not have, ContractError where it is not fitted.
    """
    name = model.removesuffix(CLOSED)
    folder = FIT / name / FOLDER if model != name else FIT / name
    if name not in settings.models:
        there_are = ", ".join(form for each in settings.models for form in (each, closed(each)))
        raise ConfigError(f"no model {model!r} in this run; there are {there_are}", key="models")
    parameters = _read(folder / "parameters.json")
    if NO_MODEL in parameters:
        raise ContractError(
            f"no model to export: {parameters[NO_MODEL]}", file=folder / "parameters.json"
        )
    robot, motion = settings.dataset.robot, settings.dataset.motion
    recorded = training_steps(robot, motion)
    return {
        "format": FORMAT,
        "dataset": settings.dataset.name,
        "model": model,
        "joints": list(robot.joints),
        "task": list(recorded.chain.task),
        "units": UNITS,
        "rate_per_s": motion.rate,
        "parameters": parameters,
        "closed_loop_share": parameters.get(SHARE, 0.0),
        "estimates": _estimates(name, closed_form=model != name),
        "covariance_of_estimates": None if model != name else _read(FIT / name / "covariance.json"),
        "pose_covariance_rad2": pose_covariance(recorded),
        "ranges": _ranges(recorded, parameters.get(SHARE, 0.0), motion.rate),
        "arm": chain_record(recorded.chain),
        "run": {
            "sha256": _hash([*SOURCES, folder / "parameters.json"]),
            "sources": [file.as_posix() for file in (*SOURCES, folder / "parameters.json")],
            "seed": settings.seed,
            "scale": settings.scale.name,
            "takes": len(recorded.q),
        },
    }


def _estimates(name: str, *, closed_form: bool) -> dict[str, float]:
    """The estimates of the fit with their standard errors and, where there are enough takes, 95 %
    intervals, and ``u_unbounded`` of a Gaussian model; of a closed loop its own.
    """
    metrics = _read(FIT / name / "fit.json")
    if closed_form:
        return {key: value for key, value in metrics.items() if key.startswith("closed_loop_")}
    known = _read(FIT / name / "covariance.json")["estimates"]
    ends = ("", "_standard_error", "_interval_low", "_interval_high")
    names = [f"{key}{end}" for key in known for end in ends] + ["u_unbounded"]
    return {name: metrics[name] for name in names if name in metrics}


def pose_covariance(recorded: Recorded) -> list[list[float]] | None:
    """(n, n) rad², of one measured pose, half that of a step; None where it is not known."""
    try:
        return (recorded.measurement / 2).tolist()
    except ModelDomainError:
        return None


def _ranges(recorded: Recorded, share: float, rate: float) -> dict[str, dict[str, Any]]:
    """What a loaded model warns by: the poses of ``recorded`` and its commanded speeds by name,
    with what a closed loop of ``share`` corrects.
    """
    if share > 0:
        q, v = recorded.q, mean_path(recorded).corrected(recorded.q, share)
        noise = recorded.q_next - q - recorded.chain.nominal_step(q, v)
        recorded = replace(recorded, v=v, noise=noise)
    rows = fitted_ranges(recorded, rate)
    return {
        quantity: rows[rows["quantity"] == quantity]
        .set_index("name")[["unit", "least", "greatest"]]
        .to_dict("index")
        for quantity in ("pose", "speed")
    }


def _read(file: Path) -> dict[str, Any]:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContractError(f"cannot be read ({error}); run the stage fit", file=file) from None


def _hash(files: list[Path]) -> str:
    """SHA-256 of the hashes of ``files``, in hexadecimal."""
    each = [hashlib.sha256(file.read_bytes()).digest() for file in files]
    return hashlib.sha256(b"".join(each)).hexdigest()
