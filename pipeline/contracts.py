"""The tables between stages: columns, units and ranges, checked on write and on read.

Every column's meaning and unit stand in its description. Joint angles q1, q2, q3 are the chain's joints in rad, in the sense of the
URDF; x, z, phi are task coordinates in the plane of the chain (m, m, rad); a step k counts the motion grid, k = 0 … M.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pandera.pandas as pa

from pipeline.errors import ContractError


def _real(description: str, low: float | None = None, high: float | None = None, *, gaps: bool = False) -> pa.Column:
    checks = [pa.Check(np.isfinite, error="must be finite")]
    if low is not None:
        checks.append(pa.Check.ge(low))
    if high is not None:
        checks.append(pa.Check.le(high))
    return pa.Column("float64", checks, nullable=gaps, description=description)


def _log_density(description: str) -> pa.Column:
    """Minus infinity is a value: what happened had no probability; a gap is where there is no density."""
    return pa.Column("float64", pa.Check(lambda x: x < np.inf, error="must not be plus infinity"), nullable=True, description=description)


def _count(description: str, low: int = 0) -> pa.Column:
    return pa.Column("int64", pa.Check.ge(low), description=description)


def _flag(description: str) -> pa.Column:
    return pa.Column("bool", description=description)


def _text(description: str, among: tuple[str, ...] | None = None) -> pa.Column:
    return pa.Column("str", pa.Check.isin(among) if among else None, description=description)


def _joints(what: str, low: float | None = None, *, gaps: bool = False, prefix: str = "q") -> dict[str, pa.Column]:
    return {f"{prefix}{j}": _real(f"{what}, joint {j}, rad", low, gaps=gaps) for j in (1, 2, 3)}


def _covariance(what: str, *, prefix: str = "c", gaps: bool = False) -> dict[str, pa.Column]:
    return {f"{prefix}{i}{j}": _real(f"{what}, entry ({i}, {j}), rad²", gaps=gaps) for i in (1, 2, 3) for j in range(i, 4)}


TAKE = {"take": _text("name of the take"), "part": _text("training or test", ("training", "test"))}
STEP = {"k": _count("step of the motion grid"), "t": _real("time since the start of the motion, s", 0.0)}
VIEW = {"view": _text("which depth frame: initial or extended", ("initial", "extended"))}
REALIZATION = {"realization": _count("number of the realisation")}

TABLES: dict[str, dict[str, pa.Column]] = {
    # ingest
    "trajectory": STEP
    | {c: _real(f"desired end-effector {c}") for c in ("x", "z", "phi")}
    | {f"v{c}": _real(f"desired end-effector velocity of {c}, per s") for c in ("x", "z", "phi")},
    "markers": TAKE
    | STEP
    | {"link": _count("link of the chain, 1 to 3; 0 for a marker without a label"), "marker": _count("marker on the link, from 1", 1)}
    | {c: _real(f"marker position {c} in the arm's base frame, m; missing while occluded", gaps=True) for c in "xyz"},
    "frames": TAKE
    | {
        "frame": _count("depth frame of the take"),
        "t": _real("time of the frame on the motion clock, s"),
        "file": _text("path of the frame's image, relative to the recordings"),
        "valid": _real("share of pixels with a depth", 0.0, 1.0),
    },
    "joint_log": TAKE | STEP | _joints("joint angle as the controller logged it"),
    "force": {
        "configuration": _text("configuration of the robots"),
        "t": _real("time since the start of the record, s", 0.0),
        "fx": _real("force at the platform along x, N, without bias"),
        "fy": _real("force at the platform along y, N, without bias"),
    },
    "quality": TAKE
    | {
        "instrument": _text("which instrument"),
        "quantity": _text("what was counted or measured"),
        "value": _real("its value"),
        "unit": _text("its unit"),
    },
    # track
    "joints": TAKE | STEP | _joints("measured joint angle") | {"residual": _real("rms residual of the rigid-body fits, m", 0.0, gaps=True)},
    # articulate
    "angles": TAKE
    | {"frame": _count("depth frame of the take"), "t": _real("time on the motion clock, s")}
    | _joints("joint angle from the depth image")
    | {c: _real(f"{c} in the plane of the arm, m") for c in ("x2", "z2", "x3", "z3", "xe", "ze")}
    | {"points": _count("points of the arm in the frame"), "objective": _real("value of the articulation objective, m", 0.0)},
    "cloud": VIEW | {"x": _real("point of the arm, x in the plane, m"), "z": _real("point of the arm, z in the plane, m")},
    "skeleton": VIEW | {"node": _count("0: O1 … 3: EE"), "x": _real("x of the fitted node, m"), "z": _real("z of the fitted node, m")},
    # noise
    "process_noise": TAKE | STEP | _joints("process noise (measured minus nominal) of the step that ends at k", prefix="w"),
    "kinect_noise": {"take": _text("take left out of the estimate; 'none' where all are in")}
    | {"frame": _count("depth frame"), "t": _real("nominal time of the frame, s")}
    | _joints("mean of the Kinect noise", prefix="b")
    | _covariance("covariance of the Kinect noise", prefix="r"),
    # fit
    "perturbation": TAKE
    | STEP
    | {"norm": _real("‖B⁻¹ − I‖_F of the fit"), "bound": _flag("fit that ended on the bound of positive definiteness")},
    "ridge": {
        "u": _real("bound û of the norm of the inverse Jacobian", 0.0),
        "alpha": _real("best α for that bound", 0.0),
        "objective": _real("objective for (ũ, α) there, or how far the log-likelihood is below its greatest", 0.0),
    },
    # evaluate
    "one_step_scores": TAKE
    | STEP
    | {
        "moving": _flag("whether the step that ends at k was commanded to move"),
        "log_density": _log_density("log density of the measured pose, measurement noise included, ln rad⁻³"),
        "log_density_noiseless": _log_density("log density under the model alone, ln rad⁻³; missing at rest"),
        "energy": _real("energy score, measurement noise included, rad"),
    }
    | {f"z{j}": _real(f"measured pose minus predicted mean in predicted standard deviations, joint {j}", gaps=True) for j in (1, 2, 3)}
    | {
        "nees": _real("normalised estimation error squared of the prediction", 0.0, gaps=True),
        "log_determinant": _real("log determinant of the predicted covariance, ln rad⁶", gaps=True),
    },
    # simulate
    "realizations": REALIZATION | STEP | _joints("simulated joint angle"),
    "moments": STEP | _joints("mean of the simulated joint angle", prefix="m") | _joints("standard deviation", 0.0, prefix="s"),
    # filter
    "posterior": TAKE
    | STEP
    | _joints("posterior mean", prefix="m")
    | _covariance("posterior covariance")
    | {
        "ess": _real("effective sample size", 0.0),
        "resampled": _flag("whether the step ended in resampling"),
        "measured": _flag("whether a measurement entered at the step"),
        "clipped": _count("particles whose noise covariance was clipped"),
        "outside": _count("particles beyond the joint limits or at a singular pose"),
    },
    # wrench
    "wrench_errors": {
        "agents": _count("number of cables m", 1),
        "system": _count("test system"),
        "error": _real("‖diag Cov(W) − Var(F)‖ / ‖Var(F)‖", 0.0),
        **{f"covariance_error_{form}": _real(f"‖Cov(W) − Cov(F)‖ / ‖Cov(F)‖ with the {form} Σ_S", 0.0) for form in ("diagonal", "full")},
    },
    "sigma_s": {
        "system_class": _text("bounds that the systems were drawn from"),
        "agents": _count("number of cables m", 1),
        "form": _text("diagonal, as in the paper, or full", ("diagonal", "full")),
        **{
            f"{name}{ij}": _real(f"{what}, entry ({', '.join(ij)})", None if name == "e" or (name, ij) == ("s", "12") else 0.0)
            for name, what in {
                "s": "mean of the optimal Σ_S over drawn systems",
                "se": "its standard error over the systems",
                "e": "expectation of the optimal Σ_S",
                "ee": "its standard error from quasi-Monte Carlo",
            }.items()
            for ij in ("11", "12", "22")
        },
        "clipped": _count("eigenvalues of single systems that Σ_S ≥ 0 held; entries, where Σ_S is diagonal"),
    },
    "wrench_spread": {
        "agents": _count("number of cables m", 1),
        "repeat": _count("repeat of the whole study"),
        "mean": _real("mean error over the test systems", 0.0),
        "maximum": _real("greatest error over the test systems", 0.0),
    },
    "force_density": {
        "configuration": _text("configuration of the robots"),
        "source": _text("measured or modelled", ("measured", "modelled")),
        "fx": _real("grid point, N"),
        "fy": _real("grid point, N"),
        "density": _real("kernel density, 1/N²", 0.0),
    },
    "force_moments": {
        "configuration": _text("configuration of the robots"),
        "source": _text("measured or modelled", ("measured", "modelled")),
        **{c: _real(f"mean of {c}, N") for c in ("fx", "fy")},
        **{f"var_{c}": _real(f"variance of {c}, N²", 0.0) for c in ("fx", "fy")},
        "cov": _real("covariance of fx and fy, N²"),
        "samples": _count("number of samples"),
    },
    "force_test": {
        "configuration": _text("configuration of the robots"),
        "form": _text("Σ_S of the model: diagonal, full, or none for Σ_S = 0", ("diagonal", "full", "none")),
        "energy_distance": _real("energy distance of the measured from the modelled force, N"),
        "two_sample_p_value": _real("its permutation p-value", 0.0, 1.0),
        "effective_samples": _real("samples of the record over its autocorrelation time", 0.0),
        "tested_samples": _count("samples of the thinned record", 2),
        **{f"matrix_share_{c}": _real(f"share of the modelled variance of {c} that Σ_S causes", 0.0, 1.0) for c in ("fx", "fy")},
    },
    # the synthetic laboratory's truth, for scoring alone
    "true_joints": TAKE | STEP | _joints("true joint angle"),
    "true_clock": TAKE | {"offset": _real("depth camera's clock minus motion clock at the start of the take, s")},
    # score
    "deviation": STEP
    | {"source": _text("recorded, or the model's name"), "error": _real("‖mean − recorded mean‖, rad", 0.0)}
    | _joints("standard deviation of the one-step process noise", 0.0, prefix="s"),
    "filter_error": TAKE
    | STEP
    | {"model": _text("motion model of the filter")}
    | _joints("posterior mean minus ground truth", prefix="e")
    | _joints("posterior standard deviation", 0.0, prefix="s"),
}


def _check(table: pd.DataFrame, name: str, file: Path) -> pd.DataFrame:
    schema = pa.DataFrameSchema(TABLES[name], strict=True, ordered=True)
    try:
        return schema.validate(table)
    except (pa.errors.SchemaError, pa.errors.SchemaErrors) as failed:
        error = failed.schema_errors[0] if isinstance(failed, pa.errors.SchemaErrors) else failed
        found = error.failure_cases.iloc[0]["failure_case"] if isinstance(error.failure_cases, pd.DataFrame) else error.failure_cases
        rule = getattr(error.check, "error", None) or error.check
        raise ContractError(
            f"table {name!r} breaks its contract: {error.reason_code.value.lower()}, {rule}, found {found}",
            file=file,
            column=error.schema.name,
        ) from None


def write(table: pd.DataFrame, name: str, folder: Path) -> None:
    """Write ``table`` as ``folder/name.parquet`` after checking it; the same table gives the same bytes."""
    file = Path(folder) / f"{name}.parquet"
    unknown = [column for column in table.columns if column not in TABLES[name]]
    table = table[[column for column in TABLES[name] if column in table.columns] + unknown].reset_index(drop=True)
    for column, definition in TABLES[name].items():
        # counts of any width, but never what would have to be rounded
        if column in table.columns and str(definition.dtype) == "int64" and pd.api.types.is_integer_dtype(table[column]):
            table[column] = table[column].astype("int64")
    _check(table, name, file).to_parquet(file, index=False, compression="zstd")


def read(name: str, folder: Path) -> pd.DataFrame:
    """Read and check ``folder/name.parquet``; ContractError names the stage's folder where it is missing."""
    file = Path(folder) / f"{name}.parquet"
    if not file.is_file():
        raise ContractError(f"there is no table {name!r}: the dataset lacks the instrument for it, or its stage has not run", file=file)
    try:
        table = pd.read_parquet(file)
    except (OSError, ValueError) as error:
        raise ContractError(f"table {name!r} cannot be read ({error}); run its stage again", file=file) from None
    return _check(table, name, file)


def exists(name: str, folder: Path) -> bool:
    """Whether the stage that owns ``folder`` wrote table ``name`` (it does not where the dataset lacks the instrument)."""
    return (Path(folder) / f"{name}.parquet").is_file()


def write_metrics(metrics: dict, file: Path) -> None:
    """Write numbers for ``dvc metrics`` as JSON, in full precision; ContractError for one that is not finite."""
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in metrics.items()}
    if broken := [name for name, value in plain.items() if not math.isfinite(value)]:
        raise ContractError(f"{', '.join(broken)} not finite", file=file)
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_name(f".{file.name}.partial")
    partial.write_text(json.dumps(plain, indent=2) + "\n")
    partial.replace(file)


@contextmanager
def replacing(folder: Path) -> Iterator[Path]:
    """A fresh folder to write into that takes the place of ``folder`` when the block ends well, and vanishes when it does not."""
    folder = Path(folder)
    partial = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        yield partial
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    if folder.exists():
        shutil.rmtree(folder)
    partial.rename(folder)


def stacked(table: pd.DataFrame, columns: list[str], *, by: str = "take") -> tuple[list[str], np.ndarray]:
    """Names (N,) and values (N, K, columns) of a table that holds the same K rows for each value of ``by``, in the order of the table."""
    names = list(dict.fromkeys(table[by]))
    values = table[columns].to_numpy()
    if (
        not names
        or len(values) % len(names)
        or not (table[by].to_numpy().reshape(len(names), -1) == np.array(names, dtype=object)[:, None]).all()
    ):
        raise ContractError(f"not every {by} has the same number of rows, one after the other", lengths=table[by].value_counts().to_dict())
    return names, values.reshape(len(names), -1, len(columns))
