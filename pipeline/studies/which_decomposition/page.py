"""The page of the study and its figure."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style
from pipeline.studies.frame import Results, number
from pipeline.studies.which_decomposition.laws import GAUSSIAN, PIVOTED, PLAIN, QR, QR_TRANSPOSED
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
SHOWN = (PIVOTED, "lu_xzp", "lu_zxp", QR, QR_TRANSPOSED, GAUSSIAN)  # in tables
PAGE = """The paper decomposes the Jacobian, J = J₁J₂, by LU, and names QR for redundant arms.
Every decomposition is another law of the noise. Which of them do the printed Σ_ω, σ_B and (α, u)
and the "small difference" between the two matrix models allow?

**The printed numbers {verb} the decomposition.** LU without pivoting, the row of φ not first, has
{later} of the likelihood of pivoted LU, by order, path prior and set of quantities, the tolerance
integrated out. With ramps and rest the most likely of these orders has, over pivoted LU (95 %
interval by the number of paths), {best}. QR of J has {odds}. QR of Jᵀ has {control}: on the widest
1 % of the paths its standard deviation is {widest} of the printed one.

{figure}

## Evidence

**Path prior.** {counts[0]} random paths of 3.2 s at 100 steps/s: straight lines in the joints or
the task, one way or there and back, and ellipses, a third each. Uniform: the start within the joint
limits, the tool ({tool} m), rest at each end ({rest} s), ramps ({ramp} s) and the peak speed
({peak} of the limit). Every pose keeps the joint limits and ‖J⁻¹‖_F < 18; no model of the noise
selects paths. Second prior: {counts[1]} paths at constant speed, the fastest joint at its limit.

The likelihood of a decomposition is the mean over the paths of ∏ N(ln x; 0, ln² f), f the
tolerance, the factors x counted as independent. Σ_ω and σ_B: standard deviations of joints 1 and 2,
Wishart model over printed (the paper: the excess of joint 3 is not captured). (α, u): root of the
trace, Gaussian model over printed. Small difference: root of the trace, Wishart over Gaussian
model.

{evidence}

Integrals are over f from {span[0]:g} to {span[1]:g}, uniform in ln ln f. LU without pivoting, φ not
first, over pivoted LU with Σ_ω represented by {choices}.

## Findings

- The Gaussian model at (α, u) has the printed trace or more on {ramped} of the paths with ramps and
  rest, on {constant} at constant full speed: Σ_ω and (α, u) hardly go together.
- Pivoted LU at the printed σ_B has at least {least} times the standard deviation of the Gaussian
  model on every path: pivoted LU, the printed (α, u) and the small difference exclude each other.
- Post hoc, formed after these numbers were known: with Σ_k = α(u² − ‖J⁻¹‖²)/n², α unsquared, that
  ratio is {post[low_ratio]:.3g} to {post[high_ratio]:.3g} on 90 % of the paths, and all quantities
  are {post[likelihood]:.3g} times as likely at f = {post[tolerance]:g}.
- On the motion of a UR5, millimetres instead of metres change the noise by a factor of
  {pivoted_lu:.3g} under pivoted LU, {qr:.3g} under QR of J and {qr_transposed:.3g} under QR of
  Jᵀ; a turn of the base changes it under pivoted LU alone
  ([units.csv](which_decomposition/units.csv)).
{level}
**Rule for every arm.** LU with partial pivoting (as MATLAB's `lu`) if the task has as many rows as
the arm has joints, QR of J if it has fewer; in metres, radians and the stated axes of the task. QR
of Jᵀ is the control that no unit and no axis changes.

**What would change the answer.** The paper's path or recordings, or the weight of its convex
problem: σ̂_B is taken as printed, although its estimator is biased. Paths on which a pivot vanishes
count against LU without pivoting."""


def page(results: Results) -> list[str]:
    """Return the page's parts."""
    tables, options = results.tables, results.options
    evidence, widths, level = tables["evidence"], tables["widths"], tables.get("level")
    integrated = evidence[evidence["tolerance"] == 0]
    rows = integrated[integrated["size"] == evidence["size"].iloc[0]]
    ends = rows[rows["reading"].isin(PHI_LATER)]["likelihood"]
    best = []
    for name, words in QUANTITIES.items():
        part = main_rows(rows[(rows["quantities"] == name) & rows["reading"].isin(PHI_LATER)])
        most = part.loc[part["likelihood"].idxmax()]
        value, low, high = (number(most[key]) for key in ("likelihood", "low", "high"))
        best.append(f"{words}: {value} ({low} to {high}, {NAMES[most['reading']]})")
    choices = []
    for size, part in integrated.groupby("size", sort=False):
        own = main_rows(part)
        first, last = (
            span(own[own["quantities"] == name], PHI_LATER)
            for name in ("sigma_b", "small_difference")
        )
        choices.append(f"{size} {first}, with all quantities {last}")
    main, by = main_rows(widths).set_index("reading"), widths.set_index(["reading", "prior"])
    ramped, constant = (f"{100 * share:.2g} %" for share in by.loc[GAUSSIAN, "reached"])
    unsquared, units = tables["unsquared"], tables["units"]
    still = units[units["turn"] == 0].pivot(index="reading", columns="unit", values="noise")
    ranges = {
        name: "{:g} to {:g}".format(*getattr(options, name))
        for name in ("tool", "rest", "ramp", "peak")
    }
    text = PAGE.format(
        verb="do not determine" if ends.min() < 1 < ends.max() else "favour one side of",
        later=span(rows, PHI_LATER),
        best="; ".join(best),
        odds=span(rows, [QR]),
        control=span(rows, [QR_TRANSPOSED]),
        widest=number(main.loc[QR_TRANSPOSED, "best"]),
        figure=results.figure,
        counts=[number(n) for n in widths.groupby("prior", sort=False)["paths"].first()],
        evidence=evidence_table(evidence),
        span=options.span,
        choices="; ".join(choices),
        level="" if level is None else level_text(level),
        ramped=ramped,
        constant=constant,
        least=number(by.loc[PIVOTED, "least_ratio"].min()),
        post=unsquared[unsquared["reading"] == PIVOTED].iloc[-1],
        **ranges,
        **(still["mm"] / still["m"]).to_dict(),
    )
    return [text]


def main_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the first prior."""
    return rows[rows["prior"] == rows["prior"].iloc[0]]


def odds(ratio: float) -> str:
    """Return a ratio of likelihoods as 3:1 or 1:3."""
    return f"{number(ratio)}:1" if ratio >= 1 else f"1:{number(1 / ratio)}"


def span(rows: pd.DataFrame, readings: list[str]) -> str:
    """Return least and greatest likelihood of ``readings`` as odds."""
    values = rows[rows["reading"].isin(readings)]["likelihood"]
    return f"{odds(values.min())} to {odds(values.max())}"


def level_text(level: pd.DataFrame) -> str:
    """Return the finding at the recorded level: σ_B and standard deviations by joint."""
    texts = []
    for reading in ("recorded", PIVOTED, QR, QR_TRANSPOSED):
        own = level[level["reading"] == reading]
        stds = "/".join(number(1000 * std) for std in own["std"])
        name = f"{NAMES.get(reading, reading)} {stds}"
        sigma_b = own["sigma_b"].iloc[0]
        texts.append(name if reading == "recorded" else f"{name} (σ̂_B {number(sigma_b)})")
    return (
        "- With σ̂_B by moments, which forces the trace, the standard deviations of the joints are, "
        f"in mrad: {'; '.join(texts)}.\n"
    )


def evidence_table(evidence: pd.DataFrame) -> str:
    """Return a row a reading: the likelihoods of the first prior, and the range over all priors."""
    rows = evidence[evidence["size"] == evidence["size"].iloc[0]]
    tolerances, lines = sorted(set(rows["tolerance"]) - {0.0}), []

    def several(texts: Iterable[str]) -> str:
        first, *others = texts
        return f"{first} ({', '.join(others)})"

    for reading in SHOWN[:-1]:
        here = rows[rows["reading"] == reading]
        main = main_rows(here).set_index(["quantities", "tolerance"])["likelihood"]
        cells = [several(number(main[name, f]) for f in tolerances) for name in QUANTITIES]
        ends = here[here["tolerance"] == 0]["likelihood"]
        lines.append([NAMES[reading], *cells, f"{number(ends.min())}–{number(ends.max())}"])
    over = f"over pivoted LU, f = {several(f'{f:g}' for f in tolerances)}"
    return table([over, *QUANTITIES.values(), "integrated, all sets and priors"], lines)


def draw(widths: pd.DataFrame, evidence: pd.DataFrame) -> Figure:
    """Decompositions that the printed numbers allow.

    (a) Standard deviation of a step at the printed parameters over the printed one (grey: 1), roots
    of traces: median and middle 90 % of the paths with ramps and rest; an arrow marks an interval
    that goes on. (b) Likelihood over the one of pivoted LU (grey: 1), the tolerance integrated out:
    marks for the paths with ramps and rest, lines from the least to the greatest of six path
    priors.
    """
    main, limits = main_rows(widths).set_index("reading"), (0.02, 30)
    place = {reading: height for height, reading in enumerate(main.index)}
    figure, ((left, right),) = style.panels(
        style.TWO_COLUMNS, 0.27 * len(place) + 0.95, columns=2, sharey=True, width_ratios=(1, 1.25)
    )
    dot = {"color": style.BLACK, "marker": "o", "markersize": 4}
    for reading, height in place.items():
        low, median, high = main.loc[reading, ["low", "median", "high"]]
        left.hlines(height, low, min(high, limits[1]), color=style.BLACK, linewidth=1.2)
        left.plot(median, height, **dot)
        if high > limits[1]:
            left.plot(limits[1], height, **dot | {"marker": ">"}, clip_on=False)
    rows = evidence[(evidence["tolerance"] == 0) & (evidence["size"] == evidence["size"].iloc[0])]
    labels = {"sigma_b": r"$\Sigma_\omega$ and $\sigma_B$", "alpha_u": r"with ($\alpha$, $u$)"}
    looks = (("o", style.BLUE), ("s", style.ORANGE), ("D", style.VERMILLION))
    for shift, name, (marker, color) in zip((-0.22, 0, 0.22), QUANTITIES, looks, strict=True):
        part = rows[rows["quantities"] == name]
        heights = part["reading"].map(place) + shift
        ends = part.groupby(heights.round(6))["likelihood"].agg(["min", "max"])
        right.hlines(ends.index, ends["min"], ends["max"], color=color, linewidth=1.2)
        here = main_rows(part)
        look = {"marker": marker, "color": color, "label": labels.get(name, QUANTITIES[name])}
        right.plot(here["likelihood"], heights[here.index], linestyle="", markersize=4, **look)
    left.plot([], [], **dot, label="median, 90 % of the paths")
    left.plot([], [], color=style.GREY, label="printed value; pivoted LU")
    names = NAMES | {QR_TRANSPOSED: r"QR of J$^\mathsf{T}$"}
    left.set_yticks(list(place.values()), [names[reading] for reading in place])
    left.set(
        xlim=limits, ylim=(len(place) - 0.5, -0.6), xlabel="standard deviation over printed one"
    )
    right.set(xlim=(1e-3, 1e3), xlabel="likelihood over pivoted LU's")
    for axes, name in ((left, "a"), (right, "b")):
        axes.set_xscale("log")
        axes.axvline(1, color=style.GREY, linewidth=0.8, zorder=0)
        axes.tick_params(axis="y", length=0)
        style.letter(axes, name)
    figure.legend(loc="outside lower center", ncols=5, columnspacing=1.2, handlelength=1.4)
    return figure
