"""The page of the study."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from pipeline.studies.frame import Results, number
from pipeline.studies.which_decomposition.laws import (
    GAUSSIAN,
    PIVOTED,
    PLAIN,
    QR,
    QR_TRANSPOSED,
)
from pipeline.verdicts.wording import table

NAMES = {
    PIVOTED: "LU, pivoted",
    **{name: "LU, rows " + " ".join("xzφ"[row] for row in rows) for name, rows in PLAIN.items()},
    QR: "QR of J",
    QR_TRANSPOSED: "QR of Jᵀ",
    GAUSSIAN: "Gaussian model",
}
QUANTITIES = {
    "sigma_b": "Σ_ω and σ_B",
    "alpha_u": "with (α, u)",
    "small_difference": "with small difference",
}
PHI_LATER = [name for name, rows in PLAIN.items() if rows[0] != 2]
QUESTION = """The paper decomposes the Jacobian, J = J₁J₂, by LU, and names QR for redundant arms.
Every decomposition is another law of the noise. Which of them do the printed Σ_ω, σ_B and (α, u)
and the "small difference" between the two matrix models allow?"""
PRIOR = """**Path prior.** {0} random paths of 3.2 s at 100 steps/s: straight lines in the joints or
the task, one way or there and back, and ellipses, a third each. Uniform: the start within the joint
limits, the tool ({tool} m), rest at each end ({rest} s), ramps ({ramp} s) and the peak speed
({peak} of the limit). Every pose keeps the joint limits and ‖J⁻¹‖_F < 18; no model of the noise
selects paths. Second prior: {1} paths at constant speed, the fastest joint at its limit."""
LIKELIHOOD = """The likelihood of a decomposition is the mean over the paths of ∏ N(ln x; 0, ln² f),
f the tolerance, the factors x counted as independent. Σ_ω and σ_B: standard deviations of joints 1
and 2, Wishart model over printed (the paper: the excess of joint 3 is not captured). (α, u): root
of the trace, Gaussian model over printed. Small difference: root of the trace, Wishart over
Gaussian model."""
RULE = """**Rule for every arm.** LU with partial pivoting (as MATLAB's `lu`) if the task has as
many rows as the arm has joints, QR of J if it has fewer; in metres, radians and the stated axes of
the task. QR of Jᵀ is the control that no unit and no axis changes."""
LIMITS = """**What would change the answer.** The paper's path or recordings, or the weight of its
convex problem: σ̂_B is taken as printed, although its estimator is biased. Paths on which a pivot
vanishes count against LU without pivoting."""
SHOWN = (PIVOTED, "lu_xzp", "lu_zxp", QR, QR_TRANSPOSED, GAUSSIAN)  # in tables


def page(results: Results) -> list[str]:
    """Return the page's parts."""
    tables, options = results.tables, results.options
    evidence, widths, level = tables["evidence"], tables["widths"], tables.get("level")
    main = main_rows(widths).set_index("reading")
    names = ("tool", "rest", "ramp", "peak")
    ranges = {name: "{:g} to {:g}".format(*getattr(options, name)) for name in names}
    counts = widths.groupby("prior", sort=False)["paths"].first().map(number)
    return [
        QUESTION,
        " ".join(_answer(evidence, main)),
        results.figures["which_decomposition"],
        "## Evidence",
        PRIOR.format(*counts, **ranges),
        LIKELIHOOD,
        evidence_table(evidence),
        _choices(evidence, options),
        "## Standard deviations, units and level",
        width_table(main, tables["units"], level),
        _level(level),
        "\n".join(f"- {finding}" for finding in _findings(tables["unsquared"], widths)),
        RULE,
        LIMITS,
    ]


def main_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of the first prior."""
    return rows[rows["prior"] == rows["prior"].iloc[0]]


def odds(ratio: float) -> str:
    """A ratio of likelihoods as 3:1 or 1:3."""
    return f"{number(ratio)}:1" if ratio >= 1 else f"1:{number(1 / ratio)}"


def _ends(rows: pd.DataFrame, readings: list[str]) -> pd.Series:
    """Least and greatest likelihood of ``readings``, ``min`` and ``max``."""
    return rows[rows["reading"].isin(readings)]["likelihood"].agg(["min", "max"])


def _answer(evidence: pd.DataFrame, main: pd.DataFrame) -> Iterator[str]:
    rows = evidence[(evidence["tolerance"] == 0) & (evidence["size"] == evidence["size"].iloc[0])]
    ends = _ends(rows, PHI_LATER)
    verb = "do not determine" if ends["min"] < 1 < ends["max"] else "favour one side of"
    yield (
        f"**The printed numbers {verb} the decomposition.** LU without pivoting, the row of φ not "
        f"first, has {' to '.join(map(odds, ends))} of the likelihood of pivoted LU, by order, "
        "path prior and set of quantities, the tolerance integrated out."
    )
    texts = []
    for name, words in QUANTITIES.items():
        part = main_rows(rows[(rows["quantities"] == name) & rows["reading"].isin(PHI_LATER)])
        best = part.loc[part["likelihood"].idxmax()]
        ends = f"{number(best['low'])} to {number(best['high'])}"
        texts.append(f"{words}: {number(best['likelihood'])} ({ends}, {NAMES[best['reading']]})")
    yield (
        "With ramps and rest the most likely of these orders has, over pivoted LU (95 % interval "
        f"by the number of paths), {'; '.join(texts)}."
    )
    qr, control = (" to ".join(map(odds, _ends(rows, [name]))) for name in (QR, QR_TRANSPOSED))
    yield (
        f"QR of J has {qr}. QR of Jᵀ has {control}: on the widest 1 % of the paths its standard "
        f"deviation is {number(main.loc[QR_TRANSPOSED, 'best'])} of the printed one."
    )


def evidence_table(evidence: pd.DataFrame) -> str:
    """A row a reading: the likelihoods of the first prior, and the range over all priors."""
    rows = evidence[evidence["size"] == evidence["size"].iloc[0]]
    tolerances, lines = sorted(set(rows["tolerance"]) - {0.0}), []
    for reading in SHOWN[:-1]:
        here = rows[rows["reading"] == reading]
        main = main_rows(here).set_index(["quantities", "tolerance"])["likelihood"]
        cells = [_listed(number(main[name, f]) for f in tolerances) for name in QUANTITIES]
        ends = here[here["tolerance"] == 0]["likelihood"]
        lines.append([NAMES[reading], *cells, f"{number(ends.min())}–{number(ends.max())}"])
    over = f"over pivoted LU, f = {_listed(f'{f:g}' for f in tolerances)}"
    return table([over, *QUANTITIES.values(), "integrated, all sets and priors"], lines)


def _listed(texts: Iterator[str]) -> str:
    first, *others = texts
    return f"{first} ({', '.join(others)})"


def _choices(evidence: pd.DataFrame, options) -> str:
    """The other comparisons of Σ_ω with σ_B."""
    texts, rows = [], evidence[(evidence["tolerance"] == 0)]
    for size in dict.fromkeys(evidence["size"]):
        low, high = (
            " to ".join(map(odds, _ends(main_rows(rows[chosen]), PHI_LATER)))
            for chosen in (
                (rows["size"] == size) & (rows["quantities"] == name)
                for name in ("sigma_b", "small_difference")
            )
        )
        texts.append(f"{size} {low}, with all quantities {high}")
    return (
        f"Integrals are over f from {options.span[0]:g} to {options.span[1]:g}, uniform in ln ln f."
        " LU without pivoting, φ not first, over pivoted LU with Σ_ω represented by "
        f"{'; '.join(texts)}."
    )


def width_table(main: pd.DataFrame, units: pd.DataFrame, level: pd.DataFrame | None) -> str:
    """A row a reading: standard deviations on the paths, noise of the arm in space, level of the
    recordings.
    """
    header = ["", "std over printed: all; joints", "over Gaussian: least; median"]
    header += ["UR5: m; mm; base turned"]
    header += [] if level is None else ["recorded level: σ̂_B; std by joint (mrad)"]
    lines = []
    for reading in SHOWN:
        row, noise = main.loc[reading], units[units["reading"] == reading]
        joints = "/".join(number(row[f"joint_{j}"]) for j in (1, 2, 3))
        cells = [NAMES[reading], f"{number(row['median'])}; {joints}"]
        cells.append(f"{number(row['least_ratio'])}; {number(row['median_ratio'])}")
        still = noise[noise["turn"] == 0].set_index("unit")["noise"]
        turned = noise[noise["turn"] != 0]["noise"].agg(["min", "max"]).map(number)
        known = not noise.empty
        cells.append(
            f"{number(still['m'])}; {number(still['mm'])}; {'–'.join(turned)}" if known else "–"
        )
        if level is not None:
            own = level[level["reading"] == reading]
            cells.append("–" if own.empty else f"{number(own['sigma_b'].iloc[0])}; {_joints(own)}")
        lines.append(cells)
    return table(header, lines)


def _joints(rows: pd.DataFrame) -> str:
    return "/".join(number(1000 * std) for std in rows["std"])


def _level(level: pd.DataFrame | None) -> str:
    text = "Medians over the paths. UR5: noise over step, the base turned about z. "
    if level is None:
        return text + "The recordings have no level: the measurement noise is unknown."
    return text + (
        "Recorded level: σ̂_B by moments, which forces the trace, not its division among the "
        f"joints; recorded {_joints(level[level['reading'] == 'recorded'])} mrad."
    )


def _findings(unsquared: pd.DataFrame, widths: pd.DataFrame) -> Iterator[str]:
    by = widths.set_index(["reading", "prior"])
    ramped, constant = (f"{100 * share:.2g} %" for share in by.loc[GAUSSIAN, "reached"])
    yield (
        f"The Gaussian model at (α, u) has the printed trace or more on {ramped} of the paths with "
        f"ramps and rest, on {constant} at constant full speed: Σ_ω and (α, u) hardly go together."
    )
    yield (
        "Pivoted LU at the printed σ_B has at least "
        f"{number(by.loc[PIVOTED, 'least_ratio'].min())} times the standard deviation of the "
        "Gaussian model on every path: pivoted LU, the printed (α, u) and the small difference "
        "exclude each other."
    )
    pivoted = unsquared[unsquared["reading"] == PIVOTED].iloc[-1]
    yield (
        "Post hoc, formed after these numbers were known: with Σ_k = α(u² − ‖J⁻¹‖²)/n², α "
        f"unsquared, that ratio is {number(pivoted['low_ratio'])} to "
        f"{number(pivoted['high_ratio'])} on 90 % of the paths, and all quantities are "
        f"{number(pivoted['likelihood'])} times as likely at f = {pivoted['tolerance']:g}."
    )
