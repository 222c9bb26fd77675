"""The page of the study and its figure."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style
from pipeline.studies.frame import Tables, number
from pipeline.studies.which_decomposition.evidence import (
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
SHOWN = (PIVOTED, "lu_xzp", "lu_zxp", QR, QR_TRANSPOSED)  # in the page's table
LEVEL = """- With σ̂_B by moments, which forces the trace, the standard deviations of the joints
  are, in mrad: {}.
"""


def facts(tables: Tables, options: object) -> dict[str, object]:
    """Return the fields of the page."""
    evidence, widths, units = tables["evidence"], tables["widths"], tables["units"]
    integrated = evidence[evidence["tolerance"] == 0]
    rows = of_first(integrated, "size")
    later = rows[rows["reading"].isin(PHI_LATER)]
    best = []
    for name, words in QUANTITIES.items():
        part = of_first(later[later["quantities"] == name], "prior")
        most = part.loc[part["likelihood"].idxmax()]
        value, low, high = map(number, most[["likelihood", "low", "high"]])
        best.append(f"{words}: {value} ({low} to {high}, {NAMES[most['reading']]})")
    choices = []
    for size, part in integrated.groupby("size", sort=False):
        own = of_first(part, "prior").groupby("quantities")
        first, last = (span(own.get_group(x), PHI_LATER) for x in ("sigma_b", "small_difference"))
        choices.append(f"{size} {first}, with all quantities {last}")
    by = widths.set_index(["reading", "prior"])
    ramped, constant = (f"{100 * share:.2g} %" for share in by.loc[GAUSSIAN, "reached"])
    unsquared = tables["unsquared"]
    still = units[units["turn"] == 0].pivot(index="reading", columns="unit", values="noise")
    ranges = ("tool", "rest", "ramp", "peak")
    return {
        "verb": "do not determine"
        if later["likelihood"].min() < 1 < later["likelihood"].max()
        else "favour one side of",
        "later": span(later, PHI_LATER),
        "best": "; ".join(best),
        "odds": span(rows, [QR]),
        "control": span(rows, [QR_TRANSPOSED]),
        "widest": number(by.loc[QR_TRANSPOSED, "best"].iloc[0]),
        "counts": [number(n) for n in widths.groupby("prior", sort=False)["paths"].first()],
        "evidence": evidence_table(of_first(evidence, "size")),
        "span": options.span,
        "choices": "; ".join(choices),
        "level": level_text(tables["level"]) if "level" in tables else "",
        "ramped": ramped,
        "constant": constant,
        "least": number(by.loc[PIVOTED, "least_ratio"].min()),
        "post": unsquared[unsquared["reading"] == PIVOTED].iloc[-1],
        **{name: "{:g} to {:g}".format(*getattr(options, name)) for name in ranges},
        **(still["mm"] / still["m"]).to_dict(),
    }


def of_first(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return the rows whose ``column`` is as in the first of them."""
    return rows[rows[column] == rows[column].iloc[0]]


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
        sigma_b = "" if reading == "recorded" else f" (σ̂_B {number(own['sigma_b'].iloc[0])})"
        stds = "/".join(number(1000 * std) for std in own["std"])
        texts.append(f"{NAMES.get(reading, reading)} {stds}{sigma_b}")
    return LEVEL.format("; ".join(texts))


def evidence_table(rows: pd.DataFrame) -> str:
    """Return a row a reading: the likelihoods of the first prior, and the range over all priors."""
    tolerances, lines = sorted(set(rows["tolerance"]) - {0.0}), []

    def several(texts: Iterable[str]) -> str:
        first, *others = texts
        return f"{first} ({', '.join(others)})"

    for reading in SHOWN:
        here = rows[rows["reading"] == reading]
        main = of_first(here, "prior").set_index(["quantities", "tolerance"])["likelihood"]
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
    main, limits = of_first(widths, "prior").set_index("reading"), (0.02, 30)
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
    rows = of_first(evidence[evidence["tolerance"] == 0], "size")
    labels = {"sigma_b": r"$\Sigma_\omega$ and $\sigma_B$", "alpha_u": r"with ($\alpha$, $u$)"}
    looks = (("o", style.BLUE), ("s", style.ORANGE), ("D", style.VERMILLION))
    for shift, name, (marker, color) in zip((-0.22, 0, 0.22), QUANTITIES, looks, strict=True):
        part = rows[rows["quantities"] == name]
        heights = part["reading"].map(place) + shift
        ends = part.groupby(heights.round(6))["likelihood"].agg(["min", "max"])
        right.hlines(ends.index, ends["min"], ends["max"], color=color, linewidth=1.2)
        here = of_first(part, "prior")
        look = {"marker": marker, "color": color, "label": labels.get(name, QUANTITIES[name])}
        right.plot(here["likelihood"], heights[here.index], linestyle="", markersize=4, **look)
    left.plot([], [], **dot, label="median, 90 % of the paths")
    left.plot([], [], color=style.GREY, label="printed value; pivoted LU")
    names = NAMES | {QR_TRANSPOSED: r"QR of J$^\mathsf{T}$"}
    left.set_yticks(list(place.values()), [names[reading] for reading in place])
    left.set(
        xlim=limits, ylim=(len(place) - 0.5, -0.6), xlabel="standard deviation over printed one (1)"
    )
    right.set(xlim=(1e-3, 1e3), xlabel="likelihood over pivoted LU's (1)")
    for axes, name in ((left, "a"), (right, "b")):
        axes.set_xscale("log")
        axes.axvline(1, color=style.GREY, linewidth=0.8, zorder=0)
        axes.tick_params(axis="y", length=0)
        style.letter(axes, name)
    figure.legend(loc="outside lower center", ncols=5, columnspacing=1.2, handlelength=1.4)
    return figure
