"""The page of the study: what the models say of a parallel robot, and the law of its wrench."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.studies import page
from pipeline.studies.hexapod.load import OneSigmaS
from pipeline.verdicts.wording import table

TITLE = "A hexapod: the same models on a parallel robot, and its dual"
NAMES = {
    "additive": "additive",
    "gaussian": "Gaussian",
    "qr_transposed": "Wishart, QR of Jᵀ",
    "qr": "Wishart, QR of J",
}
ASKED = """A Stewart platform is the dual of an arm. Its J⁻¹ is known in closed form, with the rows
nᵢᵀ, (bᵢ × nᵢ)ᵀ of the legs, and its pose by Newton's method alone; and where an arm is singular J⁻¹
grows without bound, where a hexapod is J does. Here the models of the paper, by the same code as
for an arm, stand on one motion that turns the platform towards the quarter turn at which its legs
no longer hold it. The one free number of each model is set so that all give the legs the same
noise. J⁻ᵀ maps the thrusts of the legs to the wrench: the law of the cables, with legs that push
too."""
LIMITS = """The noise of the legs is exact; that of the pose is to first order in it. All numbers
are of the one robot and motion in the study's `params.yaml`; nothing was recorded. Rotations and
moments are scaled by a characteristic length: with QR of J and in the Gaussian model it decides
what noise the legs have."""


@dataclass(frozen=True)
class Facts:
    """What the page says beside the tables."""

    reached: dict[str, float]  # from where Newton's method started → greatest error of a pose, m
    noise: float  # of the legs over their step, of every model
    sigma_b: dict[str, float]  # of each Wishart model
    matrix: OneSigmaS  # the matrix model of the wrench
    length: float  # characteristic, m


def sections(tables: dict[str, pd.DataFrame], facts: Facts) -> list[str]:
    """The page's sections from the study's tables."""
    links = [page.write_csv(rows, "hexapod", name) for name, rows in tables.items()]
    return [
        ASKED,
        "## The motion",
        motion_answer(tables["hexapod_motion"], facts),
        page.figure("hexapod", "hexapod_motion"),
        motion_table(tables["hexapod_motion"], facts),
        "## The wrench",
        wrench_answer(tables["hexapod_wrench"], tables["hexapod_thrust"], facts),
        page.figure("hexapod", "hexapod_wrench"),
        sigma_table(facts),
        "## Limits",
        LIMITS,
        f"All numbers: {', '.join(links)}.",
    ]


def growth(values: Iterable[float]) -> float:
    """Greatest over least."""
    values = np.asarray(values)
    return float(values.max() / values.min())


def motion_answer(motion: pd.DataFrame, facts: Facts) -> str:
    """What the pose's noise does along the motion, in bullets."""
    by_model = {name: rows for name, rows in motion.groupby("model", sort=False)}
    least = by_model["additive"]["least_singular_value"]
    rotation = {name: growth(rows["rotation"]) for name, rows in by_model.items()}
    legs = growth(by_model["gaussian"]["legs"])
    turned = page.listed(
        [f"{page.number(rotation[n])} ({NAMES[n]})" for n in ("additive", "gaussian")]
    )
    return "\n".join(
        [
            f"- The least singular value of J⁻¹ falls from {page.number(least.iloc[0])} to "
            f"{page.number(least.iloc[-1])}. Newton's method returns the commanded poses within "
            + page.listed(
                [f"{page.number(e)} m from {start}" for start, e in facts.reached.items()]
            )
            + ".",
            "- **Noise of the legs becomes noise of the pose through J**: the rotation's standard "
            f"deviation is at the greatest {turned} times what it is at the least, with QR of Jᵀ "
            f"{page.number(rotation['qr_transposed'])} times.",
            "- **The norm of J⁻¹ has a bound on a hexapod**: its rows are unit vectors and "
            "lever arms. So the Gaussian model's noise of the legs, which on an arm falls towards "
            f"a singular pose, changes by a factor of {page.number(legs)}.",
            "- **QR of J puts the noise into the task**: it is the same share of the task's step "
            "at every pose, and the rotation's standard deviation changes by a factor of "
            f"{page.number(rotation['qr'])}. In that reading no pose is worse than another.",
        ]
    )


def motion_table(motion: pd.DataFrame, facts: Facts) -> str:
    """A row for each model."""
    lines = []
    for name, rows in motion.groupby("model", sort=False):
        first, last = rows.iloc[0], rows.iloc[-1]
        ends = [
            page.number(1e3 * end[column])
            for column in ("legs", "position", "rotation")
            for end in (first, last)
        ]
        lines.append([NAMES[name], page.number(facts.sigma_b.get(name, np.nan)), *ends])
    header = ["model", "σ_B"] + [
        f"{what}, {end}"
        for what in ("legs (mm)", "position (mm)", "rotation (mrad)")
        for end in ("start", "end")
    ]
    text = (
        "Standard deviations after one step. The noise of the legs is "
        f"{page.number(facts.noise)} of their step, root mean square over the motion, in every "
        "model."
    )
    return f"{text}\n\n{table(header, lines)}"


def wrench_answer(wrench: pd.DataFrame, thrust: pd.DataFrame, facts: Facts) -> str:
    """What the wrench's noise does along the motion, in bullets."""
    error, variances = facts.matrix.errors, wrench["exact"] ** 2
    total = growth(np.sqrt(variances.groupby(wrench["place"]).sum()))
    least, most = thrust["thrust"].min(), thrust["thrust"].max()
    return "\n".join(
        [
            f"- Under a constant load the thrusts go from {page.number(least)} N, negative where a "
            f"leg pulls, to {page.number(most)} N, and with them the noise of the wrench by a "
            f"factor of {page.number(total)}: the legs' directions are uncertain, and what they "
            "disturb is the thrust.",
            "- The variances of the matrix model with one diagonal Σ_S for the whole motion are "
            f"off by {page.number(100 * error.mean())} % on average and "
            f"{page.number(100 * error.max())} % at most (‖diag Cov − Var‖/‖Var‖, moments over the "
            "characteristic length).",
        ]
    )


def sigma_table(facts: Facts) -> str:
    """Σ_S, row by row of the wrench."""
    text = (
        "The diagonal of Σ_S·10⁴, the mean of the optimal ones over the motion; moments are "
        f"divided by the characteristic length of {page.number(facts.length)} m."
    )
    header = ["F_x", "F_y", "F_z", "M_x", "M_y", "M_z"]
    values = [page.number(1e4 * entry) for entry in facts.matrix.diagonal]
    return f"{text}\n\n{table(header, [values])}"
