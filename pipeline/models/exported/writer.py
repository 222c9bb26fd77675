"""Records of exported models, which :mod:`.reader` reads, and their files."""

import json
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.arm.chain import Chain, PlanarChain
from pipeline.core import contracts
from pipeline.core.errors import ModelDomainError
from pipeline.models.closed_loop import SHARE
from pipeline.models.exported.copied import READER_NAME, reader_source
from pipeline.models.exported.reader import FORMAT, UNLIMITED
from pipeline.models.joint_error.choice import unconfirmed
from pipeline.models.joint_error.fit import Options as ErrorOptions
from pipeline.models.joint_error.fit import fit_joint_error
from pipeline.models.joint_error.held_out import (
    MOVING,
    held_out,
    ranges_of_runs,
    score_runs,
)
from pipeline.models.joint_error.samples import JointRun, lags_of_logs
from pipeline.models.steps import Recorded
from pipeline.randommatrix.wishart import largest_dispersion

UNITS = {
    "joint angle": "rad, m of a prismatic joint",
    "command": "step of the task's rows in 1/rate_per_s, m and rad (angular rows times the arm's "
    "length where it has one), then of the joints where it is longer",
    "joint step": "commanded step of each joint in 1/rate_per_s, rad",
}
EXPORTED_RANGES = ("pose", "speed", "joint speed", "error")


def write_export(record: dict[str, Any], file: Path) -> None:
    """Write ``record`` to ``file``, the reader into the same folder, and print how to load it."""
    reader = file.parent / READER_NAME
    contracts.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", file)
    contracts.write_text(reader_source(), reader)
    print(f"export: wrote {file} and {reader}")
    print(
        f"export: in that folder: from {reader.stem} import load; load('{file.name}')",
    )
    for entry in record["not_known"]:
        print(f"export: not known: {entry['parameter']}: {entry['found']}")


def step_record(
    model: str,
    dataset: str,
    recorded: Recorded,
    parameters: dict[str, Any],
    not_known: list[dict[str, str]],
    ranges: pd.DataFrame,
) -> dict[str, Any]:
    """Return the JSON record of a law of steps, fitted to ``recorded``; ``ranges`` is the table of
    the fitted ranges. Raises ModelDomainError as :func:`require_covariance`.
    """
    require_covariance(model, parameters, recorded)
    try:
        pose_covariance = (recorded.measurement / 2).tolist()  # half a step's
    except ModelDomainError:  # the noise of a measured pose is not known
        pose_covariance = None
    return _header(model, dataset, recorded.joints, recorded.rate) | {
        "task": list(recorded.chain.task),
        "closed_loop_share": parameters.get(SHARE, 0.0),
        "pose_covariance_rad2": pose_covariance,
        "arm": chain_record(recorded.chain),
        "parameters": parameters,
        "not_known": not_known,
        "ranges": _plain_ranges(ranges),
    }


def _header(
    model: str,
    dataset: str,
    joints: Sequence[str],
    rate: float,
) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "dataset": dataset,
        "model": model,
        "joints": list(joints),
        "units": UNITS,
        "rate_per_s": rate,
    }


def require_covariance(
    model: str,
    parameters: dict[str, Any],
    recorded: Recorded,
) -> None:
    """Raise ModelDomainError for a Wishart model without a covariance."""
    if parameters["kind"] != "wishart":
        return
    sigma_b = parameters["sigma_b"]
    limit = largest_dispersion(len(recorded.chain.task), inverse_moments=2)
    if sigma_b >= limit:
        raise ModelDomainError(
            f"{model}: sigma_b {sigma_b:.3g} is not below {limit:.3g}, where a step has a "
            "covariance; the recordings give no Wishart model to predict with",
        )


def chain_record(chain: Chain) -> dict[str, Any]:
    """Return the parameters of ``chain`` as plain values, enough to rebuild it without a URDF."""
    record: dict[str, Any] = {}
    record["kind"] = "planar" if isinstance(chain, PlanarChain) else "serial"
    for parameter in fields(chain):
        value = getattr(chain, parameter.name)
        record[parameter.name] = value.tolist() if isinstance(value, ndarray) else value
    for name in UNLIMITED:
        record[name] = [limit if np.isfinite(limit) else None for limit in record[name]]
    return record


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
    pose_noises = [run.pose_noise for run in runs if run.pose_noise]
    return _header(model, dataset, law.joints, law.rate) | {
        "closed_loop_share": 0.0,
        "pose_noise_rad": max(pose_noises, default=None),
        "parameters": law.parameters(),
        "not_known": [*unconfirmed(scores, model), *_unknown_lag(runs)],
        "ranges": _plain_ranges(ranges_of_runs(runs)),
        "runs": [_run_record(law, run) for run in runs],
    }


def _run_record(law, run: JointRun) -> dict[str, Any]:
    return {
        "name": run.name,
        "motion": run.motion,
        "samples": len(run.command),
        "lag_s": run.lag.tolist(),
        "scores": scores_by_horizon(law, run)[0],
    }


def _unknown_lag(runs: Sequence[JointRun]) -> list[dict[str, str]]:
    """Return an entry of ``not_known`` if all ``runs`` are of one log."""
    if len(lags_of_logs(runs)) > 1:
        return []
    return [
        {
            "parameter": "spread of the lag of another run",
            "found": "unknown: all runs are of one log",
            "required": "2 logs",
        },
    ]


def scores_by_horizon(law, run: JointRun) -> tuple[dict[str, float], pd.DataFrame]:
    """Return horizon → mean log score of the commanded samples of ``run`` in nats (1/rad), and the
    rows of :func:`score_runs`.
    """
    rows = pd.DataFrame(score_runs(law, [run])[0])
    if rows.empty:
        return {}, rows
    rows = rows[rows["samples"] == MOVING]
    means = {}
    for horizon, scored in rows.groupby("horizon", sort=False):
        means[horizon] = float(np.average(scored["score"], weights=scored["count"]))
    return means, rows


def _plain_ranges(ranges: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Return quantity → name → unit, least and greatest value, from a table of ``ranges``."""
    plain = {}
    for quantity, rows in ranges.groupby("quantity", sort=False):
        if quantity in EXPORTED_RANGES:
            ends = rows.set_index("name")[["unit", "least", "greatest"]]
            plain[quantity] = ends.to_dict("index")
    return plain
