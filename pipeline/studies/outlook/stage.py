"""outlook: the models on the two systems that the paper names as extensions, a hexapod and cables
that tow a load in space.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from pydantic import Field

from pipeline.core import rng
from pipeline.core.options.analysis import Positive
from pipeline.core.validation import options
from pipeline.figures import style
from pipeline.studies.frame import MISSING, Results, Study, interval, number
from pipeline.studies.outlook.hexapod import (
    Hexapod,
    PlatformMotion,
    equal_models,
    hexapod_rows,
    pose_of,
    straight,
)
from pipeline.studies.outlook.towing import ERRORS, error_rows, recorded_rows, slope_rows
from pipeline.verdicts.wording import table
from pipeline.wrench.bounds import study_bounds

Triple = tuple[float, float, float]
Points = Annotated[list[Triple], Field(min_length=6, max_length=6)]
PAGE = """Do the paper's models serve the systems that it names as extensions: a hexapod, and cables
that tow a load in space?

**Hexapod.** Every model serves by the same code. All models give the legs the same noise, {noise:g}
of their step. The motion turns the platform towards the pose at which its legs no longer hold it:
the least singular value of J⁻¹ falls from {least[0]:.3g} to {least[1]:.3g}. The standard deviation
of the rotation grows by a factor of {additive:.3g} with the additive model, {gaussian:.3g} with the
Gaussian model and {qr_transposed:.3g} with the Wishart model under QR of Jᵀ. Under QR of J the
factor is {qr:.3g}: this decomposition puts the noise into the task, and no pose has more of it than
another. The norm of J⁻¹ is bounded on a hexapod, so the Gaussian model's noise hardly depends on
the pose.

**Towing.** The error of the matrix model falls with the number of cables m in space as in the
plane, for moments as for forces; a slope of −1/2 is that of an average over m cables. The table has
{few} and {many} cables, the mean over {repeats} repeats, and the slope of the log error over log m
with its 95 % interval. Recorded directions of the very system give its own Σ_S and Ψ_S.

{table}

{figure}

**What would change it.** The noise of the pose is of first order in that of the legs, for one robot
and one motion. Rotations and moments are scaled by a characteristic length, {length:g} m and the
root mean square lever; under QR of J and in the Gaussian model this length decides the noise of the
legs. Nothing was recorded: a hexapod's log would show which of the models its noise follows."""


@options()
class Options:
    """Geometry of hexapod and load, in m and rad, and sizes; params.yaml describes each."""

    base: Points
    platform: Points
    position: tuple[Triple, Triple]
    turn: tuple[Triple, Triple]
    legs: tuple[float, float]
    length: Positive
    places: Annotated[int, Field(ge=2)]
    noise: Positive
    bound: Annotated[float, Field(gt=1)]
    attachment: tuple[float, float]
    elevation: tuple[float, float]
    agents: Annotated[list[int], Field(min_length=2)]
    recorded: Annotated[int, Field(ge=2)]
    few: Annotated[int, Field(ge=2)]


def motion_of(options: Options) -> PlatformMotion:
    """Return the hexapod's motion; raises ConfigError for a robot or motion that cannot exist."""
    robot = Hexapod(np.array(options.base), np.array(options.platform), options.length)
    ends = map(pose_of, np.array(options.position), np.array(options.turn))
    return straight(robot, *ends, options.legs, options.places)


def evaluate(settings: SimpleNamespace, options: Options) -> dict[str, pd.DataFrame]:
    """Return the study's tables; raises what :func:`motion_of` does."""
    motion, study = motion_of(options), settings.wrench
    bounds = replace(
        study_bounds(study), attachment=options.attachment, elevation=options.elevation
    )
    errors, recorded, sizes = [], [], (study.systems, study.test_systems)
    for repeat in range(study.repeats):
        stream = rng.stream(settings.seed, "outlook.towing", repeat)
        rows = error_rows(bounds, options.agents, sizes, stream)
        errors += [row | {"repeat": repeat} for row in rows]
    for m in (options.agents[0], options.agents[-1]):
        sizes = (study.systems, options.few, options.recorded)
        stream = rng.stream(settings.seed, "outlook.recorded", m)
        recorded += recorded_rows(bounds, m, sizes, stream)
    errors = pd.DataFrame(errors)
    return {
        "hexapod": hexapod_rows(motion, equal_models(motion, options.noise, options.bound)),
        "towing": errors,
        "towing_slopes": slope_rows(errors),
        "towing_recorded": pd.DataFrame(recorded),
    }


def page(results: Results) -> list[str]:
    """Return the page's parts."""
    options, motion, errors = results.options, results.tables["hexapod"], results.tables["towing"]
    ends = motion.groupby("model", sort=False)["rotation"].agg(["first", "last"])
    means = 100 * errors.groupby(["part", "agents"])[[*ERRORS, "shift"]].mean()
    counts = errors["agents"].min(), errors["agents"].max()
    known = results.tables["towing_recorded"].set_index(["part", "agents", "known"])["error"]
    rows = []
    for row in results.tables["towing_slopes"].itertuples():
        cells = [f"{means.loc[(row.part, m), row.error]:.3g}" for m in counts]
        form = "diagonal" if row.error == "variance" else "full"
        cells.append(interval(row.slope, row.low, row.high))
        rows.append([f"{row.error} of {row.part}, {form} Σ_S", *cells])
    for part in ("forces", "moments"):
        cells = [f"{100 * known[part, m, 'directions']:.3g}" for m in counts]
        name = f"covariance of {part}, Σ_S and Ψ_S of recorded directions"
        rows.append([name, *cells, MISSING])
        cells = [f"{means.loc[(part, m), 'shift']:.3g}" for m in counts]
        rows.append([f"mean of {part}, over the standard deviation", *cells, MISSING])
    header = ["error of the matrix model (%)", *(f"m = {number(m)}" for m in counts), "slope"]
    text = PAGE.format(
        noise=options.noise,
        least=motion["least_singular_value"].iloc[[0, -1]].tolist(),
        few=counts[0],
        many=counts[1],
        repeats=errors["repeat"].nunique(),
        table=table(header, rows),
        figure=results.figure,
        length=options.length,
        **(ends["last"] / ends["first"]).to_dict(),
    )
    return [text]


def draw(hexapod: pd.DataFrame, towing: pd.DataFrame) -> Figure:
    """Motion models on a hexapod, and the wrench of towing cables.

    (a) Standard deviation of the platform's rotation after one step, along the motion; all models
    give the legs the same noise. (b) Error of the matrix model of the wrench over the number of
    cables, mean over the repeats: variances with the diagonal Σ_S (full lines), covariances with
    the full Σ_S (dashed).
    """
    lines = {
        "additive": style.MODELS["additive"] | {"label": "additive"},
        "gaussian": style.MODELS["gaussian"] | {"label": "Gaussian"},
        "qr_transposed": {
            "label": r"Wishart, QR of $J^{\mathsf{T}}$",
            "color": style.BLUE,
            "ls": "--",
        },
        "qr": {"label": "Wishart, QR of $J$", "color": style.GREEN, "ls": (0, (6, 1.5, 1, 1.5))},
    }
    figure, ((rotation, wrench),) = style.panels(style.TWO_COLUMNS, 2.6, columns=2)
    for model, line in lines.items():
        rows = hexapod[hexapod["model"] == model]
        rotation.plot(rows["place"], 1e3 * rows["rotation"], **line)
    rotation.set(xlabel="share of the motion", ylabel="std of the rotation (mrad)", ylim=(0, None))
    means = 100 * towing.groupby(["part", "agents"])[list(ERRORS)].mean()
    for part, color in (("forces", style.BLUE), ("moments", style.VERMILLION)):
        for error, dashes in zip(ERRORS, ("-", "--"), strict=True):
            look = {"color": color, "marker": "o", "ms": 2.5, "label": f"{error} of {part}"}
            wrench.plot(means.loc[part, error], dashes, **look)
    wrench.set(xscale="log", yscale="log", xlabel="number of cables", ylabel="error (%)")
    ticks = list(means.index.unique("agents"))
    wrench.set_xticks(ticks, [str(m) for m in ticks])
    wrench.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    wrench.minorticks_off()
    for name, axes in zip("ab", (rotation, wrench), strict=True):
        style.letter(axes, name)
        axes.legend()
    return figure


run = Study("The models on a hexapod and on a towed load", Options, evaluate, page, draw).run
