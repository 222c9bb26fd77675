"""outlook: the models on the two systems that the paper names as extensions, a hexapod and cables
that tow a load in space.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.core import rng
from pipeline.figures import style
from pipeline.statistics.takes import paired_difference
from pipeline.studies.frame import MISSING, Study, Tables, interval, joined, number
from pipeline.studies.outlook import hexapod as legs
from pipeline.verdicts.wording import table
from pipeline.wrench.models import (
    Bounds,
    CableSystem,
    draw_systems,
    matrix_model,
    moment_fit,
    sample_directions,
    study_bounds,
    wrench_covariance,
    wrench_mean,
)
from pipeline.wrench.study import averaged_sigma_s, covariance_errors, variance_errors

PARTS = {"forces": slice(3), "moments": slice(3, 6)}
# form of Σ_S, and distance from the parametric model
ERRORS = {"variance": ("diagonal", variance_errors), "covariance": ("full", covariance_errors)}


def motion_of(options: SimpleNamespace) -> legs.PlatformMotion:
    """Return the hexapod's motion; raises ConfigError for a robot or motion that cannot exist."""
    robot = legs.Hexapod(np.array(options.base), np.array(options.platform), options.length)
    ends = map(legs.pose_of, np.array(options.position), np.array(options.turn))
    return legs.straight(robot, *ends, options.legs, options.places)


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables; raises what :func:`motion_of` does."""
    motion, study = motion_of(options), settings.wrench
    models = legs.equal_models(motion, options.noise, options.bound)
    ranges = {"attachment": options.attachment, "elevation": options.elevation}
    bounds, systems, errors = replace(study_bounds(study), **ranges), study.systems, []
    for repeat in range(study.repeats):
        stream = rng.stream(settings.seed, "outlook.towing", repeat)
        rows = error_rows(bounds, options.agents, (systems, study.test_systems), stream)
        errors.append(rows.assign(repeat=repeat))
    recorded = [
        recorded_rows(bounds, m, (systems, options.few, options.recorded), stream)
        for m in (options.agents[0], options.agents[-1])
        for stream in [rng.stream(settings.seed, "outlook.recorded", m)]
    ]
    return {
        "hexapod": legs.hexapod_rows(motion, models),
        "towing": joined(errors),
        "towing_slopes": slope_rows(joined(errors)),
        "towing_recorded": joined(recorded),
    }


def lever(bounds: Bounds) -> float:
    """Return the root mean square distance in m of an attachment from the load's origin."""
    low, high = bounds.attachment
    return float(np.sqrt(bounds.dimension * (low**2 + low * high + high**2) / 3))


def error_rows(
    bounds: Bounds, agents: Sequence[int], sizes: tuple[int, int], rng: np.random.Generator
) -> pd.DataFrame:
    """Return rows of ``towing``: Σ_S over ``sizes[0]`` systems, tested on ``sizes[1]`` others."""
    rows = []
    for m, stream in zip(agents, rng.spawn(len(agents)), strict=True):
        drawn, fresh = (
            draw_systems(bounds, size, m, stream).in_units_of(lever(bounds)) for size in sizes
        )
        model, due = matrix_model(fresh), wrench_covariance(fresh)
        estimates, shift = averaged_sigma_s(drawn), model.mean() - wrench_mean(fresh)
        for part, block in PARTS.items():
            own, row = due[:, block, block], {"part": part, "agents": m}
            for error, (form, distance) in ERRORS.items():
                modelled = model.covariance(estimates[form].mean)[:, block, block]
                row[error] = distance(modelled, own).mean()
            std = np.sqrt(np.trace(own, axis1=-2, axis2=-1))
            row["shift"] = np.mean(np.linalg.norm(shift[:, block], axis=-1) / std)
            rows.append(row)
    return pd.DataFrame(rows)


def slope_rows(errors: pd.DataFrame) -> pd.DataFrame:
    """Return the table ``towing_slopes``: slopes of log error over log m, Student's interval."""
    rows = []
    for part, own in errors.groupby("part", sort=False):
        for error in ERRORS:
            means = np.log(own.pivot(index="agents", columns="repeat", values=error))
            slopes = np.polyfit(np.log(means.index.to_numpy(float)), means.to_numpy(), 1)[0]
            rows.append((part, error, *paired_difference(slopes, np.zeros_like(slopes))))
    return pd.DataFrame(rows, columns=["part", "error", "slope", "low", "high"])


def recorded_rows(
    bounds: Bounds, agents: int, sizes: tuple[int, int, int], rng: np.random.Generator
) -> pd.DataFrame:
    """Return rows of the table ``towing_recorded``: errors over ``sizes[1]`` systems with Σ_S from
    bounds (the mean over ``sizes[0]`` systems), and with Σ_S and Ψ_S from ``sizes[2]`` recorded
    directions of each cable of the very system.
    """
    size = lever(bounds)
    sigma_s = averaged_sigma_s(draw_systems(bounds, sizes[0], agents, rng).in_units_of(size))
    drawn = draw_systems(bounds, sizes[1], agents, rng).in_units_of(size)
    due, bounded, known = [], [], []
    for k in range(sizes[1]):
        parts = (getattr(drawn, field.name) for field in fields(drawn))
        system = CableSystem(*(part if part is None else part[k] for part in parts))
        directions = sample_directions(system.direction, system.concentration, sizes[2], rng)
        fit = moment_fit(np.einsum("mnp,kmp->knm", system.maps(), directions))
        model = matrix_model(system)
        bounded.append(model.covariance(sigma_s["full"].mean))
        known.append(replace(model, jacobian=fit.mean, psi=fit.psi).covariance(fit.sigma_s))
        due.append(wrench_covariance(system))
    rows = []
    for part, block in PARTS.items():
        own = np.array(due)[:, block, block]
        for name, modelled in (("bounds", bounded), ("directions", known)):
            error = covariance_errors(np.array(modelled)[:, block, block], own).mean()
            rows.append({"part": part, "agents": agents, "known": name, "error": error})
    return pd.DataFrame(rows)


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    motion, errors = tables["hexapod"], tables["towing"]
    ends = motion.groupby("model", sort=False)["rotation"].agg(["first", "last"])
    means = 100 * errors.groupby(["part", "agents"])[[*ERRORS, "shift"]].mean()
    few, many = errors["agents"].min(), errors["agents"].max()
    known = tables["towing_recorded"].pivot(index=["part", "agents"], columns="known")
    means["directions"], rows = 100 * known["error", "directions"], []

    def add(name: str, part: str, column: str, slope: str = MISSING) -> None:
        rows.append([name, *(f"{means.loc[(part, m), column]:.3g}" for m in (few, many)), slope])

    for row in tables["towing_slopes"].itertuples():
        form, slope = ERRORS[row.error][0], interval(row.slope, row.low, row.high)
        add(f"{row.error} of {row.part}, {form} Σ_S", row.part, row.error, slope)
    for part in PARTS:
        add(f"covariance of {part}, Σ_S and Ψ_S of recorded directions", part, "directions")
        add(f"mean of {part}, over the standard deviation", part, "shift")
    header = ["error of the matrix model (%)", f"m = {number(few)}", f"m = {number(many)}", "slope"]
    return {
        "noise": options.noise,
        "least": motion["least_singular_value"].iloc[[0, -1]].tolist(),
        "few": few,
        "many": many,
        "repeats": errors["repeat"].nunique(),
        "table": table(header, rows),
        "length": options.length,
    } | (ends["last"] / ends["first"]).to_dict()


def draw(hexapod: pd.DataFrame, towing: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    blue, green, dashes = style.BLUE, style.GREEN, (0, (6, 1.5, 1, 1.5))
    lines = {
        "additive": style.MODELS["additive"] | {"label": "additive"},
        "gaussian": style.MODELS["gaussian"] | {"label": "Gaussian"},
        "qr_transposed": {"label": r"Wishart, QR of $J^{\mathsf{T}}$", "color": blue, "ls": "--"},
        "qr": {"label": "Wishart, QR of $J$", "color": green, "ls": dashes},
    }
    figure, ((rotation, wrench),) = style.panels(style.TWO_COLUMNS, 2.6, columns=2)
    for model, line in lines.items():
        rows = hexapod[hexapod["model"] == model]
        rotation.plot(rows["place"], 1e3 * rows["rotation"], **line)
    rotation.set(xlabel="share of the motion (1)", ylabel="std of the rotation (mrad)")
    rotation.set_ylim(0, None)
    means = 100 * towing.groupby(["part", "agents"])[list(ERRORS)].mean()
    for part, color in (("forces", blue), ("moments", style.VERMILLION)):
        for error, dashes in zip(ERRORS, ("-", "--"), strict=True):
            look = {"color": color, "marker": "o", "ms": 2.5, "label": f"{error} of {part}"}
            wrench.plot(means.loc[part, error], dashes, **look)
    wrench.set(xscale="log", yscale="log", xlabel="number of cables", ylabel="error (%)")
    ticks = list(means.index.unique("agents"))
    wrench.set_xticks(ticks, [str(m) for m in ticks])
    wrench.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    wrench.minorticks_off()
    style.letters((rotation, wrench))
    rotation.legend()
    wrench.legend()
    return figure


run = Study(evaluate, facts, draw).run
