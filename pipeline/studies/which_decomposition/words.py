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
LIKELIHOOD = """The likelihood of a decomposition is the mean over the paths of ∏ N(ln x; 0, ln² f),
f the tolerance, the factors x counted as independent:

- Σ_ω and σ_B: standard deviations of joints 1 and 2, Wishart model over printed (the paper: the
  excess of joint 3 is not captured);
- (α, u): root of the trace, Gaussian model over printed;
- small difference: root of the trace, Wishart over Gaussian model."""
RULE = """**Rule for every arm.** LU with partial pivoting (as MATLAB's `lu`) if the task has as
many rows as the arm has joints, QR of J if it has fewer; in metres, radians and the stated axes of
the task. The QR of Jᵀ stands beside both as the control that no unit and no axis changes."""
LIMITS = """The paper's path or recordings, or the weight of its convex problem: σ̂_B is taken as
printed, although its estimator is biased. Paths on which a pivot vanishes count against LU without
pivoting."""
SHOWN = (PIVOTED, "lu_xzp", "lu_zxp", "lu_xpz", QR, QR_TRANSPOSED, GAUSSIAN)  # in tables


def main_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of ``evidence`` of the first prior."""
    return rows[rows["prior"] == rows["prior"].iloc[0]]


def page(results: Results) -> list[str]:
    """Return the page's parts."""
    tables, options = results.tables, results.options
    evidence, widths = tables["evidence"], tables["widths"]
    main = widths[widths["prior"] == widths["prior"].iloc[0]].set_index("reading")
    return [
        QUESTION,
        _prior(options, widths),
        "## Answer",
        " ".join(_answer(evidence, main)),
        results.figures["which_decomposition"],
        "## Evidence",
        LIKELIHOOD,
        evidence_table(evidence),
        _choices(evidence, options),
        "## Widths, units and level",
        width_table(main, tables["units"], tables.get("level")),
        _level(tables.get("level")),
        "\n".join(f"- {finding}" for finding in _findings(tables, widths)),
        RULE,
        "## What would change the answer",
        LIMITS,
    ]


def _prior(options, widths: pd.DataFrame) -> str:
    names = ("tool", "rest", "ramp", "peak")
    ranges = {name: "{:g} to {:g}".format(*getattr(options, name)) for name in names}
    counts = widths.groupby("prior", sort=False)["paths"].first()
    return (
        f"**Path prior.** {number(counts.iloc[0])} random paths of 3.2 s at 100 steps/s: straight "
        "lines in the joints or the task, one way or there and back, and ellipses, a third each. "
        "Uniform: the start within the joint limits, the tool "
        f"({ranges['tool']} m), rest at each end ({ranges['rest']} s), ramps ({ranges['ramp']} s) "
        f"and the peak speed ({ranges['peak']} of the limit). Every pose keeps the joint limits "
        "and ‖J⁻¹‖_F < 18; no model of the noise selects paths. Second prior: "
        f"{number(counts.iloc[1])} paths at constant speed, the fastest joint at its limit."
    )


def _integrated(evidence: pd.DataFrame, size: str | None = None) -> pd.DataFrame:
    size = evidence["size"].iloc[0] if size is None else size
    return evidence[(evidence["tolerance"] == 0) & (evidence["size"] == size)]


def odds(ratio: float) -> str:
    """A ratio of likelihoods as 3:1 or 1:3."""
    return f"{number(ratio)}:1" if ratio >= 1 else f"1:{number(1 / ratio)}"


def _extremes(rows: pd.DataFrame, readings: list[str]) -> tuple[float, float]:
    chosen = rows[rows["reading"].isin(readings)]["likelihood"]
    return float(chosen.min()), float(chosen.max())


def _answer(evidence: pd.DataFrame, main: pd.DataFrame) -> Iterator[str]:
    rows = _integrated(evidence)
    low, high = _extremes(rows, PHI_LATER)
    verb = "do not determine" if low < 1 < high else "favour one side of"
    yield (
        f"**The printed numbers {verb} the decomposition.** LU without pivoting, the row of φ not "
        f"first, has {odds(low)} to {odds(high)} of the likelihood of pivoted LU, by order, path "
        "prior and set of quantities, the tolerance integrated out."
    )
    texts = []
    for name, words in QUANTITIES.items():
        part = main_rows(rows[rows["quantities"] == name])
        part = part[part["reading"].isin(PHI_LATER)].sort_values("likelihood")
        best = part.iloc[-1]
        ends = f"{number(best['low'])} to {number(best['high'])}"
        texts.append(f"{words}: {number(best['likelihood'])} ({ends}, {NAMES[best['reading']]})")
    yield (
        "With ramps and rest the most likely of these orders has, over pivoted LU (95 % interval "
        f"by the number of paths), {'; '.join(texts)}."
    )
    ends = {reading: map(odds, _extremes(rows, [reading])) for reading in (QR, QR_TRANSPOSED)}
    yield (
        f"QR of J has {' to '.join(ends[QR])}. QR of Jᵀ has {' to '.join(ends[QR_TRANSPOSED])}: "
        f"on the widest 1 % of the paths its standard deviation is "
        f"{number(main.loc[QR_TRANSPOSED, 'best'])} of the printed one."
    )


def evidence_table(evidence: pd.DataFrame) -> str:
    """A row a reading: the likelihoods of the first prior, and the range over all priors."""
    rows = evidence[evidence["size"] == evidence["size"].iloc[0]]
    tolerances = sorted(set(rows["tolerance"]) - {0.0})
    first, *others = (f"{f:g}" for f in tolerances)
    header = [f"over pivoted LU, f = {first} ({', '.join(others)})", *QUANTITIES.values()]
    lines = []
    for reading in SHOWN[:-1]:
        here = rows[rows["reading"] == reading]
        main = main_rows(here).set_index(["quantities", "tolerance"])["likelihood"]
        cells = []
        for name in QUANTITIES:
            first, *others = (number(main[name, f]) for f in tolerances)
            cells.append(f"{first} ({', '.join(others)})")
        ends = here[here["tolerance"] == 0]["likelihood"]
        lines.append([NAMES[reading], *cells, f"{number(ends.min())}–{number(ends.max())}"])
    return table([*header, "integrated, all sets and priors"], lines)


def _choices(evidence: pd.DataFrame, options) -> str:
    """The other comparisons of Σ_ω with σ_B."""
    ends = []
    for size in dict.fromkeys(evidence["size"]):
        rows = main_rows(_integrated(evidence, size))
        low, high = (
            " to ".join(map(odds, _extremes(rows[rows["quantities"] == name], PHI_LATER)))
            for name in ("sigma_b", "small_difference")
        )
        ends.append(f"{size} {low}, with all quantities {high}")
    return (
        f"Integrals are over f from {options.span[0]:g} to {options.span[1]:g}, uniform in ln ln f."
        " What represents Σ_ω matters as much as the path. LU without pivoting, φ not first, over "
        f"pivoted LU: {'; '.join(ends)}."
    )


def width_table(main: pd.DataFrame, units: pd.DataFrame, level: pd.DataFrame | None) -> str:
    """A row a reading: widths on the paths, noise of the arm in space, level of the recordings."""
    header = ["", "std over printed: all; joints", "over Gaussian: least; median"]
    header += ["UR5: m; mm; base turned"]
    header += [] if level is None else ["recorded level: σ̂_B; std by joint (mrad)"]
    lines = []
    for reading in SHOWN:
        row = main.loc[reading]
        joints = "/".join(number(row[f"joint_{j}"]) for j in (1, 2, 3))
        cells = [f"{number(row['median'])}; {joints}"]
        cells += [f"{number(row['least_ratio'])}; {number(row['median_ratio'])}"]
        cells += [_unit_cell(units[units["reading"] == reading])]
        if level is not None:
            cells += [_level_cell(level[level["reading"] == reading])]
        lines.append([NAMES[reading], *cells])
    return table(header, lines)


def _unit_cell(rows: pd.DataFrame) -> str:
    if rows.empty:
        return "–"
    still = rows[rows["turn"] == 0].set_index("unit")["noise"]
    turned = rows[rows["turn"] != 0]["noise"]
    ends = f"{number(turned.min())}–{number(turned.max())}"
    return f"{number(still['m'])}; {number(still['mm'])}; {ends}"


def _level_cell(rows: pd.DataFrame) -> str:
    if rows.empty:
        return "–"
    return f"{number(rows['sigma_b'].iloc[0])}; {_by_joint(rows)}"


def _by_joint(rows: pd.DataFrame) -> str:
    return "/".join(number(1000 * std) for std in rows["std"])


def _level(level: pd.DataFrame | None) -> str:
    text = "Medians over the paths. UR5: noise of a step over the step, the base turned about z. "
    if level is None:
        return text + "The recordings have no level: the measurement noise is unknown."
    recorded = _by_joint(level[level["reading"] == "recorded"])
    return text + (
        "Recorded level: σ̂_B by moments, which forces the trace, not its division among the "
        f"joints; recorded {recorded} mrad."
    )


def _findings(tables: dict[str, pd.DataFrame], widths: pd.DataFrame) -> Iterator[str]:
    by = widths.set_index(["prior", "reading"])
    ramped, constant = dict.fromkeys(widths["prior"])
    shares = [by.loc[(prior, GAUSSIAN), "reached"] for prior in (ramped, constant)]
    yield (
        "The Gaussian model at (α, u) has the printed trace or more on "
        f"{100 * shares[0]:.2g} % of the paths with ramps and rest, on {100 * shares[1]:.2g} % at "
        "constant full speed: Σ_ω and (α, u) hardly go together."
    )
    least = min(by.loc[(prior, PIVOTED), "least_ratio"] for prior in (ramped, constant))
    yield (
        f"Pivoted LU at the printed σ_B is at least {number(least)} times as wide as the Gaussian "
        "model on every path: pivoted LU, the printed (α, u) and the small difference exclude "
        "each other."
    )
    rows = tables["unsquared"].set_index(["reading", "tolerance"])
    tolerance = rows.index[-1][1]
    pivoted = rows.loc[(PIVOTED, tolerance)]
    yield (
        "Post hoc, formed after these numbers were known: with Σ_k = α(u² − ‖J⁻¹‖²)/n², α "
        f"unsquared, that ratio is {number(pivoted['low_ratio'])} to "
        f"{number(pivoted['high_ratio'])} on 90 % of the paths, and all quantities are "
        f"{number(pivoted['likelihood'])} times as likely at f = {tolerance:g}."
    )
