"""outlook: the models on the two systems that the paper names as extensions, a hexapod and cables
that tow a load in space.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from pipeline.core import rng
from pipeline.core.validation import options
from pipeline.studies.frame import Results, Study, interval, number
from pipeline.studies.outlook.hexapod import equal_models, hexapod_rows, straight
from pipeline.studies.outlook.platform import LEGS, Hexapod, pose_of
from pipeline.studies.outlook.towing import error_rows, recorded_rows, slope_rows
from pipeline.verdicts.wording import table
from pipeline.wrench.bounds import study_bounds

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
Points = Annotated[list[Triple], Field(min_length=6, max_length=6)]
Positive = Annotated[float, Field(gt=0)]


@options()
class Options:
    """Geometry of hexapod and load, in m and rad, and sizes; params.yaml describes each."""

    base: Points
    platform: Points
    position: Annotated[list[Triple], Field(min_length=2, max_length=2)]
    turn: Annotated[list[Triple], Field(min_length=2, max_length=2)]
    legs: Pair
    length: Positive
    places: Annotated[int, Field(ge=2)]
    noise: Positive
    bound: Annotated[float, Field(gt=1)]
    attachment: Pair
    elevation: Pair
    agents: Annotated[list[int], Field(min_length=2)]
    recorded: Annotated[int, Field(ge=2)]
    few: Annotated[int, Field(ge=2)]


def evaluate(settings: SimpleNamespace, options: Options) -> dict[str, pd.DataFrame]:
    """Return the study's tables; raises ConfigError for a robot or motion that cannot exist."""
    ends = [
        pose_of(np.array(position), np.array(turn))
        for position, turn in zip(options.position, options.turn, strict=True)
    ]
    robot = Hexapod(
        base=np.array(options.base),
        platform=np.array(options.platform),
        home=ends[0],
        lower=np.full(LEGS, options.legs[0]),
        upper=np.full(LEGS, options.legs[1]),
        max_speed=np.full(LEGS, np.inf),
        length=options.length,
    )
    motion = straight(robot, *ends, options.places)
    study = settings.wrench
    bounds = replace(
        study_bounds(study),
        attachment=tuple(options.attachment),
        elevation=tuple(options.elevation),
    )
    sizes = (study.systems, study.test_systems)
    errors = [
        row | {"repeat": repeat}
        for repeat in range(study.repeats)
        for row in error_rows(
            bounds, options.agents, sizes, rng.stream(settings.seed, "outlook.towing", repeat)
        )
    ]
    sizes = (study.systems, options.few, options.recorded)
    recorded = [
        row
        for m in (options.agents[0], options.agents[-1])
        for row in recorded_rows(bounds, m, sizes, rng.stream(settings.seed, "outlook.recorded", m))
    ]
    errors = pd.DataFrame(errors)
    return {
        "hexapod": hexapod_rows(motion, equal_models(motion, options.noise, options.bound)),
        "towing": errors,
        "towing_slopes": slope_rows(errors),
        "towing_recorded": pd.DataFrame(recorded),
    }


def page(results: Results) -> list[str]:
    """Return the page's parts."""
    motion, slopes = results.tables["hexapod"], results.tables["towing_slopes"]
    errors, recorded = results.tables["towing"], results.tables["towing_recorded"]
    ends = motion.groupby("model", sort=False)["rotation"].agg(["first", "last"])
    growth = {name: number(row["last"] / row["first"]) for name, row in ends.iterrows()}
    least = motion["least_singular_value"]
    means = errors.groupby(["part", "agents"])[["variance", "covariance", "shift"]].mean()
    few, many = errors["agents"].min(), errors["agents"].max()
    known = recorded.set_index(["part", "agents", "known"])["error"]
    rows = []
    for row in slopes.itertuples():
        cells = [f"{100 * means.loc[(row.part, m), row.error]:.3g}" for m in (few, many)]
        form = "diagonal" if row.error == "variance" else "full"
        cells.append(interval(row.slope, row.low, row.high))
        rows.append([f"{row.error} of {row.part}, {form} Σ_S", *cells])
    for part in ("forces", "moments"):
        cells = [f"{100 * known[part, m, 'directions']:.3g}" for m in (few, many)]
        rows.append([f"covariance of {part}, Σ_S and Ψ_S of recorded directions", *cells, "–"])
        cells = [f"{100 * means.loc[(part, m), 'shift']:.3g}" for m in (few, many)]
        rows.append([f"mean of {part}, over the standard deviation", *cells, "–"])
    return [
        "Do the paper's models serve the systems that it names as extensions: a hexapod, and "
        "cables that tow a load in space?",
        f"**Hexapod.** Every model serves by the same code. All models give the legs the same "
        f"noise, {results.options.noise:g} of their step. The motion turns the platform towards "
        f"the pose at which its legs no longer hold it: the least singular value of J⁻¹ falls from "
        f"{number(least.iloc[0])} to {number(least.iloc[-1])}. The standard deviation of the "
        f"rotation grows by a factor of {growth['additive']} with the additive model, "
        f"{growth['gaussian']} with the Gaussian model and {growth['qr_transposed']} with the "
        f"Wishart model under QR of Jᵀ. Under QR of J the factor is {growth['qr']}: this "
        "decomposition puts the noise into the task, and no pose is worse than another. The norm "
        "of J⁻¹ is bounded on a hexapod, so the Gaussian model's noise hardly depends on the pose.",
        f"**Towing.** The error of the matrix model falls with the number of cables m in space as "
        f"in the plane, for moments as for forces; a slope of −1/2 is that of an average over m "
        f"cables. The table has {few} and {many} cables, the mean over "
        f"{errors['repeat'].nunique()} repeats, and the slope of the log error over log m with its "
        "95 % interval. Recorded directions of the very system give its own Σ_S and Ψ_S.",
        table(["error of the matrix model (%)", f"m = {few}", f"m = {many}", "slope"], rows),
        results.figures["outlook"],
        "**What would change it.** The noise of the pose is of first order in that of the legs, "
        "for one robot and one motion. Rotations and moments are scaled by a characteristic "
        f"length, {results.options.length:g} m and the root mean square lever; under QR of J and "
        "in the Gaussian model this length decides the noise of the legs. Nothing was recorded: a "
        "hexapod's log would show which of the models its noise follows.",
    ]


run = Study("The models on a hexapod and on a towed load", Options, evaluate, page).run
