"""The page of the study: how the errors fall with the number of cables, what the characteristic
length changes, and what recorded directions add.
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.studies import page
from pipeline.studies.wrench_moments.errors import ERRORS, Place
from pipeline.verdicts.wording import table

FULL = "covariance_full"
TITLE = "Moments, and cables in space"
NAMES = {
    "point": "plane, one point",
    "plane": "plane",
    "space": "space",
    "variance": "variances",
    "variance_median": "variances, median",
    "covariance_diagonal": "covariance, diagonal Σ_S",
    "covariance_full": "covariance, full Σ_S",
    "bounds": "bounds alone",
    "identity": "recorded S, Ψ_S = I",
    "moments": "recorded S, Ψ_S by moments",
    "likelihood": "recorded S, Ψ_S by likelihood",
}
ASKED = """The paper's numerical study takes cables that meet in one point, so that there is no
moment, in the plane. Here the same bounds on tensions, their spread, directions and concentrations
hold for cables whose attachments lie apart, in the plane and in space: three and six rows of the
wrench. An error is the distance of the modelled variances, or covariance, from the parametric ones
over their size, averaged over fresh systems. Variances are the diagonal Σ_S's, as in the paper."""
FALL = """A system's Σ_S is an average over its cables, so it is off the average over systems by
about 1/√m, and so is the error: a slope of −1/2. The slopes near it as m grows, in six rows as in
two, with one exception. Without its off-diagonal terms Σ_S lacks a covariance that grows with m as
the variances do: its error nears a floor. The mean error of a planar moment falls faster from few
cables on, its median does not: a few systems whose levers are all short have hardly any variance
and a great relative error. The bound Σ_S ≥ 0 holds eigenvalues where there are few cables, and none
where there are many."""
LENGTHS = """Rows of moments are divided by a characteristic length, so that all rows are in
newtons: the root mean square distance of an attachment from the point that the wrench is taken
about. The error over all rows depends on it: a short length gives the moments all the weight, a
long one the forces. The error of forces alone, or of moments alone, does not depend on it with the
diagonal Σ_S. With the full one it does, by the bound Σ_S ≥ 0."""
PSI = """Σ_S from bounds alone serves any system within them. Recorded directions of the one system
that is asked about give its own Σ_S, and its Ψ_S too, by two moments of S or by maximum likelihood.
The likelihood is right for a matrix-variate normal S, and this S is none: each column is a
direction, which scatters across itself and not along, so that no Σ_S ⊗ Ψ_S is its covariance."""
MEAN = """The mean of the matrix model is S̲T̲; the parametric one is shorter, since directions that
scatter pull less along their mean. The distance, over the standard deviation of the wrench, grows
with m in the forces: the shift adds up over cables, the deviation with the root of their number."""


def sections(
    places: Sequence[Place],
    samples: int,
    wrench_moments: pd.DataFrame,
    wrench_slopes: pd.DataFrame,
    recorded_psi: pd.DataFrame,
) -> list[str]:
    """The page's sections from the study's tables; ``samples`` are recorded of each system."""
    keys = ["place", "length", "agents", "part"]
    tables = {
        "wrench_moments": wrench_moments.drop(columns="repeat")
        .groupby(keys, sort=False, as_index=False)
        .mean(),
        "wrench_slopes": wrench_slopes,
        "recorded_psi": recorded_psi,
    }
    links = [page.write_csv(rows, "wrench_moments", name) for name, rows in tables.items()]
    at_one = wrench_moments[wrench_moments["length"] == 1.0]
    lengths = [
        f"{place.length:.3g} m ({NAMES[place.name]})"
        for place in places
        if place.bounds.attachment is not None
    ]
    return [
        ASKED,
        "## How the errors fall with the number of cables",
        page.figure("wrench_moments", "wrench_moments"),
        "Slope of log error over log m, mean over the repeats and its 95 % interval:",
        slopes(wrench_slopes),
        FALL,
        error_table(at_one),
        "## The characteristic length",
        f"{LENGTHS} {length_effect(wrench_moments)} Here the length is {page.listed(lengths)}. "
        "Mean error in % over all rows, with the fewest and with the most cables, over the length "
        "as a multiple of that:",
        length_table(wrench_moments),
        "## Σ_S and Ψ_S from recorded directions",
        f"{PSI} {psi_verdict(recorded_psi)} Mean error in % of the covariance, {samples} "
        "directions of each cable recorded:",
        psi_table(recorded_psi),
        "## The mean",
        f"{MEAN} In % of that deviation:",
        shift_table(at_one),
        f"All numbers: {', '.join(links)}.",
    ]


def percent(value: float) -> str:
    """An error in %, three digits."""
    return page.number(100 * value)


def slopes(wrench_slopes: pd.DataFrame) -> str:
    """A row a place, part and range of m, a column an error."""
    rows = [
        [
            f"{NAMES[place]}, {part}",
            f"m ≥ {least}",
            *(page.interval(row.slope, row.low, row.high) for row in group.itertuples()),
        ]
        for (place, part, least), group in wrench_slopes.groupby(
            ["place", "part", "least"], sort=False
        )
    ]
    return table(["slope", "over", *(NAMES[error] for error in ERRORS)], rows)


def error_table(errors: pd.DataFrame) -> str:
    """Mean errors at the fewest and the most cables, in %."""
    rows = []
    for (place, part), group in errors.groupby(["place", "part"], sort=False):
        means = group.groupby("agents")[[*ERRORS, "held"]].mean()
        for m in (means.index[0], means.index[-1]):
            values = [percent(means.loc[m, error]) for error in ERRORS]
            rows.append([f"{NAMES[place]}, {part}", str(m), *values, f"{means.loc[m, 'held']:.3g}"])
    header = ["mean error in %", "m", *(NAMES[e] for e in ERRORS), "eigenvalues held a system"]
    return table(header, rows)


def length_effect(errors: pd.DataFrame) -> str:
    """By how much the length moves the errors of one unit's covariance with the full Σ_S."""
    first = errors[(errors["repeat"] == 0) & (errors["place"] != "point")]
    one_unit = first[first["part"] != "both"].groupby(["place", "part", "agents"])[FULL]
    moved = (one_unit.max() / one_unit.min() - 1).max()
    return f"It moves that error by up to {percent(moved)} % of itself."


def length_table(errors: pd.DataFrame) -> str:
    """The error over all rows of the first repeat, a column a characteristic length."""
    both = errors[(errors["part"] == "both") & (errors["repeat"] == 0)]
    rows = []
    for place, group in both.groupby("place", sort=False):
        for error in ("variance", FULL):
            means = group.pivot(index="agents", columns="length", values=error)
            for m in (means.index[0], means.index[-1]):
                name = f"{NAMES[place]}, {NAMES[error]}"
                rows.append([name, str(m), *(percent(value) for value in means.loc[m])])
    return table(["", "m", *(f"{length:g}" for length in sorted(both["length"].unique()))], rows)


def psi_verdict(recorded_psi: pd.DataFrame) -> str:
    """In how many cases the estimates of Ψ_S beat Ψ_S = I, by their intervals."""
    texts = []
    for known in ("moments", "likelihood"):
        rows = recorded_psi[recorded_psi["known"] == known]
        better, worse = int((rows["high"] < 0).sum()), int((rows["low"] > 0).sum())
        texts.append(f"by {known} better in {better} of {len(rows)} cases and worse in {worse}")
    return f"Against Ψ_S = I the covariance is, beyond chance at 95 %, {' and '.join(texts)}."


def psi_table(recorded_psi: pd.DataFrame) -> str:
    """The error by what is known, and how far Ψ_S follows 1/κ."""
    known = list(recorded_psi["known"].unique())
    groups = recorded_psi.groupby(["place", "part", "agents"], sort=False)
    rows = [
        [
            f"{NAMES[place]}, {part}",
            str(m),
            *(percent(group.set_index("known").loc[each, "error"]) for each in known),
            f"{group['agreement'].iloc[0]:.2f}",
        ]
        for (place, part, m), group in groups
    ]
    header = ["", "m", *(NAMES[each] for each in known), "correlation of diag Ψ_S with 1/κ"]
    return table(header, rows)


def shift_table(errors: pd.DataFrame) -> str:
    """The shift of the mean at the fewest and the most cables, in %."""
    rows = []
    for (place, part), group in errors[errors["part"] != "both"].groupby(
        ["place", "part"], sort=False
    ):
        means = group.groupby("agents")["shift"].mean()
        ends = [f"{percent(means.iloc[i])} (m = {means.index[i]})" for i in (0, -1)]
        rows.append([f"{NAMES[place]}, {part}", *ends])
    return table(["", "fewest cables", "most cables"], rows)
