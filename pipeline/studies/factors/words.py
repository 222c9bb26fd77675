"""The page of the study: which readings the published numbers allow, and what speaks for which."""

from __future__ import annotations

import pandas as pd

from pipeline.cases.readings import NAMES
from pipeline.studies import page
from pipeline.studies.factors.shares import ALL, SPEEDS
from pipeline.studies.published import Published
from pipeline.verdicts.wording import table

TITLE = "Which decomposition the paper can have used"
ASKED = """The paper decomposes the mean Jacobian by LU. It leaves open whether with pivoting and
in which order of the task's rows and of the joints, and it names QR as the alternative. Each of
these readings is another law of the noise. The paper also publishes the parameters of three models
of the same recordings, and says of them that the two matrix models differ little, that the Wishart
model is the more conservative one, and that both fall short in joint 3. On which paths of the arm
do the published numbers say the same, reading by reading?"""
EXPLAINED = """Without rest, on paths that can be driven:

- **alike**: joints 1 and 2 of the two matrix models within a factor {alike:g};
- **wider**: the Wishart model wider on average over the joints;
- **joint 3 short**: joint 3 of the Wishart model below the recorded spread;
- **size**: joints 1 and 2 of the Wishart model within that factor of the recorded spread;
- **ratio**: mean spread of the Wishart model over that of the Gaussian one.

No two orders of LU without pivoting are one law. The law depends on J₁J₁ᵀ alone. Its diagonal is
one for the row that is eliminated first and more for the others, so that another order of the rows
is another law; and the column below the first pivot, and the one below the second, belong to the
joints eliminated there. With the row of φ first, whose entries are all ±1, the two orders that
differ in the first two joints alone are nearly one. Pivoted LU is at each pose one of the orders
with φ first, as the arm reaches less than 1 m."""
LIMITS = """It is an inference from the paper's numbers. Nothing in its text says which LU was used,
and nobody has published the recordings. The path of the experiment is not published either: a path
of the study is straight in the joints and driven at one speed, and neither the arm itself nor the
ground stands in its way. û is the greatest norm on the paper's path plus some ũ above zero that is
not given: the norms have no lower bound here. Spreads are those of one step, as in the paper's
figures of the standard deviation, from the exact covariance of the Wishart model; lengths are in
metres. The published values are taken as printed: σ̂_B is the dispersion of every step with which
the paper's realisations are drawn, though its estimator counts a step at rest as none, is
[biased](../errata.md#sigma-b-biased) and needs [weights](../errata.md#weights-not-given) that are
not given."""
PIVOTS = """LU without pivoting has a weakness of its own. Where a pivot vanishes its noise grows
without bound, at poses that mean nothing to the arm: in the natural order where the tip is level
with the first joint, or in line with the first link. A path that meets such a pose counts against
the reading here; the column "small pivot" counts them."""
FACTORISATIONS = {"lu": "LU"} | NAMES
NATURAL = ("lu", "x z φ", "1-2-3")
KEY = ["factorisation", "rows", "joints"]
PLACES = ("first", "in the middle", "last")


def sections(
    factors: pd.DataFrame,
    factor_paths: pd.DataFrame,
    published: Published,
    overspeed: float,
    alike: float,
) -> list[str]:
    """The page's sections.

    Args:
        factors: the table of that name.
        factor_paths: likewise.
        published: what the readings are held against.
        overspeed: greatest speed in shares of the limit.
        alike: factor within which spreads pass for alike.
    """
    links = [
        page.write_csv(rows, "factors", name)
        for name, rows in {"factors": factors, "factor_paths": factor_paths}.items()
    ]
    matched, limit = (at_speed(factors, speed) for speed in reversed(SPEEDS))
    return [
        ASKED,
        "## Answer",
        answer(matched),
        page.figure("factors", "factors"),
        "## Every reading",
        _conditions(factor_paths, published, overspeed),
        EXPLAINED.format(alike=alike),
        readings_table(matched),
        "## At the speed limit",
        _at_the_limit(limit, matched),
        readings_table(limit),
        "## Rest, tool, norm and travel",
        "At rest the matrix models have no noise, so that rest is a factor of every average over "
        "time: the more the arm rests, the faster it has to move for the published trace. Travel "
        "is that of the joint that moves farthest: how large a share is hangs on how far the "
        "random paths go, while what holds on none does not. All but “wider”, and all:",
        _subsets(factors, matched),
        _speeds(factor_paths, overspeed),
        "## What it shows and what not",
        LIMITS,
        _evidence(matched),
        PIVOTS,
        f"All numbers: {', '.join(links)}.",
    ]


def at_speed(factors: pd.DataFrame, speed: str) -> pd.DataFrame:
    """The rows of all paths at one ``speed`` and the first share of rest, by reading."""
    rows = factors[(factors["subset"] == ALL) & (factors["speed"] == speed)]
    return rows[rows["rest"] == rows["rest"].iloc[0]].set_index(KEY)


def reading_name(reading: tuple[str, str, str]) -> str:
    """A reading in words."""
    factorisation, rows, joints = reading
    name = FACTORISATIONS[factorisation]
    if factorisation == "lu":
        return f"{name}, rows {rows}, joints {joints}"
    return f"{name}, joints {joints}" if factorisation == "pivoted_lu" else name


def answer(rows: pd.DataFrame) -> str:
    """Three sentences on the table :func:`at_speed` of the matched speed: what is excluded, what
    can fit, and how much of the paper it fits.
    """
    wide, narrow = _too_wide(rows), rows.loc["qr_transposed"].iloc[0]
    excluded = wide["alike"].max() == 0 and narrow["alike"] == 0
    first = (
        "Pivoted LU, QR of J and LU with the row of φ first make the Wishart model at least "
        f"{page.number(wide['ratio_least'].min())} times as wide as the Gaussian one, and QR of "
        f"Jᵀ at most {page.number(narrow['ratio_greatest'])} times: "
        + ("on none of the " if excluded else "not on all of the ")
        + f"{page.number(rows['paths'].iloc[0])} paths are the two models alike under any of these"
        + (", so that none of these fits the paper." if excluded else ".")
    )
    natural, best, most = rows.loc[NATURAL], rows["but_wider"].idxmax(), rows["all"].idxmax()
    fitting, together = _share(natural, "but_wider"), _share(natural, "all")
    return (
        f"{first} LU without pivoting and with the row of φ not first can fit: the paper's "
        f"statements all but “wider” hold on {fitting} of the paths in the natural order (x, z, "
        f"φ; joints 1-2-3), and most often with {reading_name(best)}, on "
        f"{_share(rows.loc[best], 'but_wider')}. With “wider” too they hold on {together} of the "
        f"paths in the natural order, and on no more than {_share(rows.loc[most], 'all')} in any "
        f"({reading_name(most)})."
    )


def _too_wide(rows: pd.DataFrame) -> pd.DataFrame:
    """Pivoted LU, QR of J, and LU without pivoting whose first row is that of φ."""
    factorisation, order = (rows.index.get_level_values(name) for name in KEY[:2])
    phi_first = (factorisation == "lu") & order.str.startswith("φ")
    return rows[phi_first | factorisation.isin(["pivoted_lu", "qr"])]


def _share(row: pd.Series, name: str) -> str:
    low, high = (f"{100 * row[f'{name}_{end}']:.2g}" for end in ("low", "high"))
    return f"{100 * row[name]:.2g} % ({low} to {high} %)"


def readings_table(rows: pd.DataFrame) -> str:
    """A row a reading of :func:`at_speed`, shares of the paths in percent."""
    header = ["reading", "small pivot", "alike", "wider", "joint 3 short", "size"]
    header += ["all but wider", "all but size", "all", "ratio: least", "median", "greatest"]
    lines = []
    for reading, row in rows.iterrows():
        pivots = row["small_pivot"] / row["paths"] if row["paths"] else 0.0
        shares = row[["alike", "wider", "short", "size", "but_wider", "but_size", "all"]]
        ratios = row[["ratio_least", "ratio_median", "ratio_greatest"]]
        cells = [f"{100 * share:.1f} %" for share in (pivots, *shares)]
        lines.append([reading_name(reading), *cells, *(page.number(ratio) for ratio in ratios)])
    return table(header, lines)


def _conditions(paths: pd.DataFrame, published: Published, overspeed: float) -> str:
    first = paths.iloc[0]
    return (
        f"Of {page.number(first['drawn'])} random paths between poses within the limits of the "
        f"joints {page.number(first['paths'])} keep ‖J⁻¹‖ below û = {published.u:g}. On "
        f"{page.number(first['within_speed'])} of these the Gaussian model at û and α̂ = "
        f"{published.alpha:g} has the trace of Σ̂_ω, as its fit asks, at no more than "
        f"{overspeed:g} times the speed limit: shares are of these. "
        f"σ_B = {published.sigma_b:g}."
    )


def _at_the_limit(limit: pd.DataFrame, matched: pd.DataFrame) -> str:
    transposed = [rows.loc["qr_transposed"].iloc[0] for rows in (limit, matched)]
    alike, recorded = (_share_of(row, "alike") for row in transposed)
    return (
        "All the paths, with the fastest joint at its limit, whatever trace the Gaussian model "
        "then has. The readings that are too wide are alike on at most "
        f"{100 * _too_wide(limit)['alike'].max():.1f} % of the paths. QR of Jᵀ is alike on {alike} "
        f"of them, but on {recorded} of those on which the Gaussian model has the recorded trace."
    )


def _share_of(row: pd.Series, name: str) -> str:
    return f"{100 * row[name]:.1f} %"


def _evidence(rows: pd.DataFrame) -> str:
    natural, most = rows.loc[NATURAL], rows["all"].idxmax()
    place = PLACES[most[1].split().index("φ")]
    return (
        "For LU without pivoting in the natural order, the simplest reading, speaks that the two "
        f"models are alike on {_share_of(natural, 'alike')} of the paths, and that joint 3 is then "
        "short as the paper reports. Against it speaks “wider”, which holds together with alike "
        f"and short on {_share_of(natural, 'but_size')}. That sentence speaks for the row of φ "
        f"{place}, where all four statements hold together most often. But the paper says it of "
        "the bounds of the particle filter, and measurements narrow those."
    )


def _subsets(factors: pd.DataFrame, rows: pd.DataFrame) -> str:
    """Of the natural order and of the readings that hold most often."""
    chosen = list(dict.fromkeys([NATURAL, rows["but_wider"].idxmax(), rows["all"].idxmax()]))
    matched = factors[factors["speed"] == SPEEDS[1]].set_index(KEY)
    lines = []
    for (subset, rest), part in matched.groupby(["subset", "rest"], sort=False):
        readings = [part.loc[[key]].iloc[0] for key in chosen]
        cells = [f"{_share_of(row, 'but_wider')}, {_share_of(row, 'all')}" for row in readings]
        lines.append([subset, f"{100 * rest:g} %", page.number(part["paths"].iloc[0]), *cells])
    return table(["paths", "at rest", "number", *map(reading_name, chosen)], lines)


def _speeds(paths: pd.DataFrame, overspeed: float) -> str:
    lines = [
        [
            f"{100 * row['rest']:g} %",
            f"{100 * row['within_speed'] / row['paths']:.1f} %",
            page.number(row["speed_least"]),
            page.number(row["speed_median"]),
        ]
        for _, row in paths.iterrows()
    ]
    header = ["at rest", f"paths at {overspeed:g} of the limit", "least speed", "median speed"]
    return (
        "The speed, in shares of the limit, at which the published Σ̂_ω, û and α̂ go together:\n\n"
        + table(header, lines)
    )
