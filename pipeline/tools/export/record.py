"""The contents of an exported model's file: parameters and their errors, the arm, the ranges of the
recordings it was fitted to, and the run that it comes from.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.arm.model import chain_of
from pipeline.core import config
from pipeline.core.errors import ConfigError, ContractError, ModelDomainError
from pipeline.core.filters import CLOSED
from pipeline.models import kinds
from pipeline.models.closed_loop import FOLDER, SHARE, fit_closed_loop, mean_path
from pipeline.models.exported import FORMAT, chain_record
from pipeline.models.joint_steps_fit import LEAST_SHARE, PLAIN, fit_joint_steps
from pipeline.models.other_motions import MotionSteps, joint_ranges, motion_of, pooled
from pipeline.models.steps import Recorded
from pipeline.randommatrix.wishart import largest_dispersion
from pipeline.recordings.motions import logged_motions
from pipeline.recordings.steps import fitted_ranges, training_steps

FIT, METRICS = Path("data/fit"), Path("reports/metrics")
# sources of a run's numbers, the fitted parameters beside
SOURCES = (Path("data/config.yaml"), Path("data/track/joints.parquet"))
UNITS = {
    "joint angle": "rad, m of a prismatic joint",
    "command": "step of the task's rows in 1/rate_per_s, m and rad (angular rows times the arm's "
    "length where it has one), then of the joints where it is longer",
    "joint step": "commanded step of each joint in 1/rate_per_s, rad",
}


def exported(model: str, settings: SimpleNamespace) -> dict[str, Any]:
    """The record of ``model``: a plain model, fitted to all motions here; a model of the run or its
    closed-loop form; or any option of pipeline/conf/model, fitted here to the training takes.

    Raises ConfigError for an unknown model, and ModelDomainError where the recordings give none or
    cannot tell a parameter that its predictions need.
    """
    robot, motion = settings.dataset.robot, settings.dataset.motion
    recorded = training_steps(robot, motion)
    record = bare_record(model, settings) | {"pose_covariance_rad2": pose_covariance(recorded)}
    if model in PLAIN:
        motions = logged_motions(settings.dataset) if settings.dataset.joint_log else []
        record |= plain_record(model, motions or [motion_of(recorded)], settings.dataset)
        sources, takes = SOURCES, record["takes"]
    else:
        own, sources = _fitted(model, settings, recorded)
        share = own["parameters"].get(SHARE, 0.0)
        ranges = _ranges(recorded, share, motion.rate)
        record |= own | {"closed_loop_share": share, "ranges": ranges}
        takes = len(recorded.q)
    record["run"] = {
        "sha256": _hash([*sources]),
        "sources": [file.as_posix() for file in sources],
        "seed": settings.seed,
        "scale": settings.scale.name,
        "takes": takes,
    }
    return record


def bare_record(model: str, settings: Any) -> dict[str, Any]:
    """The part of the record that no fit decides."""
    dataset = settings.dataset
    chain = chain_of(dataset.robot)
    return {
        "format": FORMAT,
        "dataset": dataset.name,
        "model": model,
        "joints": list(dataset.robot.joints),
        "task": list(chain.task),
        "units": UNITS,
        "rate_per_s": dataset.motion.rate,
        "closed_loop_share": 0.0,
        "covariance_of_estimates": None,
        "pose_covariance_rad2": None,
        "arm": chain_record(chain),
    }


def plain_record(model: str, motions: list[MotionSteps], dataset: Any) -> dict[str, Any]:
    """The part of the record that the plain ``model`` decides, fitted to the ``motions``."""
    joints, rate = tuple(dataset.robot.joints), dataset.motion.rate
    fit = fit_joint_steps(
        model, *pooled(motions), joints, pose_noise=dataset.motion.pose_noise or 0.0
    )
    untold = [
        dict(zip(("parameter", "joint", "found", "required"), row, strict=True))
        for row in fit.untold
    ]
    return {
        "parameters": fit.model.parameters(),
        "estimates": {},
        "not_known": untold,
        "ranges": by_quantity(joint_ranges(motions, joints, rate)),
        "motions": len(motions),
        "takes": sum(len(motion.q) for motion in motions),
    }


def by_quantity(rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Ends and unit by name, for each quantity of a table of ranges that a model warns by."""
    return {
        quantity: own.set_index("name")[["unit", "least", "greatest"]].to_dict("index")
        for quantity, own in rows.groupby("quantity", sort=False)
        if quantity in ("pose", "speed", "joint speed")
    }


def _fitted(
    model: str, settings: SimpleNamespace, recorded: Recorded
) -> tuple[dict[str, Any], list[Path]]:
    """Parameters and estimates from the stage fit, or from a fit here where it has none."""
    name = model.removesuffix(CLOSED)
    closed_form, not_known = model != name, []
    folder = FIT / name / FOLDER if closed_form else FIT / name
    if name in settings.models and (folder / "parameters.json").is_file():
        parameters = _read(folder / "parameters.json")
        estimates = _estimates(name, closed_form=closed_form)
        covariance = None if closed_form else _read(FIT / name / "covariance.json")
        sources = [*SOURCES, folder / "parameters.json"]
    else:
        parameters, estimates = _fit_here(name, recorded, closed_form=closed_form)
        covariance, sources = None, [*SOURCES]
    if kinds.NO_MODEL in parameters:
        raise ModelDomainError(f"no model to export: {parameters[kinds.NO_MODEL]}", model=model)
    require_told(model, parameters, recorded)
    if parameters["kind"] == "gaussian" and estimates.get("u_unbounded"):
        # the level alone is known: α and u apart have no number
        parameters = {"kind": "gaussian", "level": parameters["alpha"] * parameters["u"]} | {
            key: value for key, value in parameters.items() if key == SHARE
        }
        estimates = {
            key: value
            for key, value in estimates.items()
            if key.split("_")[0] not in ("alpha", "u") and "_alpha" not in key
        }
        covariance = None
        not_known = [
            {
                "parameter": "alpha and u apart",
                "found": "u at the end of its search",
                "required": "a greatest likelihood or least error at a finite u",
            }
        ]
    return {
        "parameters": parameters,
        "estimates": estimates,
        "not_known": not_known,
        "covariance_of_estimates": covariance,
    }, sources


def _fit_here(
    name: str, recorded: Recorded, *, closed_form: bool
) -> tuple[dict[str, Any], dict[str, float]]:
    if name not in config.option_names("model"):
        there_are = ", ".join([*PLAIN, *config.option_names("model")])
        raise ConfigError(f"no model {name!r}; there are {there_are}", key="MODEL")
    options = config.model_options([name])[name]
    found = kinds.estimate(recorded, options)
    if not closed_form:
        known = {
            key: found.diagnostics[key] for key in ("u_unbounded",) if key in found.diagnostics
        }
        return found.parameters, found.estimates | known
    closed = fit_closed_loop(recorded, options, found)
    own = {f"closed_loop_{key}": value for key, value in closed.estimate.estimates.items()}
    return closed.estimate.parameters | {SHARE: closed.share}, own


def require_told(model: str, parameters: dict[str, Any], recorded: Recorded) -> None:
    """Raise ModelDomainError where the steps of ``recorded`` cannot tell a gain that grows with the
    speed of a joint, as the joint hardly moved, and for a Wishart model without a covariance.
    """
    if parameters["kind"] == "scaled":
        most = np.abs(recorded.chain.nominal_step(recorded.q, recorded.v)).max(axis=(0, 1))
        still = [
            f"{joint} (at most {step:.2g} rad a step)"
            for joint, step in zip(recorded.joints, most, strict=True)
            if step < LEAST_SHARE * most.max()
        ]
        if still:
            raise ModelDomainError(
                f"{model}: the recordings cannot tell how noise grows with the speed of "
                f"{', '.join(still)}, where {LEAST_SHARE * most.max():.2g} rad is required; export "
                "scaled_all or scaled_t, which all motions are fitted to, or record a motion in "
                "which they move"
            )
    limit = largest_dispersion(len(recorded.chain.task), inverse_moments=2)
    if parameters["kind"] == "wishart" and parameters.get("sigma_b", 0.0) >= limit:
        raise ModelDomainError(
            f"{model}: sigma_b {parameters['sigma_b']:.3g} is not below {limit:.3g}, where a step "
            "has a covariance; the recordings give no Wishart model to predict with"
        )


def _estimates(name: str, *, closed_form: bool) -> dict[str, float]:
    """The estimates of the fit with their standard errors and, where there are enough takes, 95 %
    intervals, and ``u_unbounded`` of a Gaussian model; of a closed loop its own.
    """
    metrics = _read(METRICS / f"fit_{name}.json")
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
    """The poses of ``recorded`` and its commanded speeds by name, with what a closed loop of
    ``share`` corrects.
    """
    if share > 0:
        q, v = recorded.q, mean_path(recorded).corrected(recorded.q, share)
        noise = recorded.q_next - q - recorded.chain.nominal_step(q, v)
        recorded = replace(recorded, v=v, noise=noise)
    return by_quantity(fitted_ranges(recorded, rate))


def _read(file: Path) -> dict[str, Any]:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContractError(f"cannot be read ({error}); run the stage fit", file=file) from None


def _hash(files: list[Path]) -> str:
    """SHA-256 of the hashes of ``files``, in hexadecimal."""
    each = [hashlib.sha256(file.read_bytes()).digest() for file in files]
    return hashlib.sha256(b"".join(each)).hexdigest()
