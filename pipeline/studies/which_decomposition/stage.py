"""which_decomposition: decompositions of the Jacobian that agree with the paper's numbers."""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import arm_of
from pipeline.core import rng
from pipeline.core.options.dataset import Robot
from pipeline.figures import style
from pipeline.studies.frame import Tables, concatenate, dataset_option, number, trials
from pipeline.studies.which_decomposition import evidence as laws
from pipeline.studies.which_decomposition.evidence import PLAIN, Published
from pipeline.studies.which_decomposition.paths import KINDS, TimeLaw, draw_paths

# M and steps a second of the paper
STEPS = 320
RATE = 100.0
RAMPED = "ramps and rest"
FULL_SPEED = "constant full speed"
PAPER_ARM = "youbot"  # independent of the run's dataset
WIDEST = 30.0  # greatest ratio on the axis of the widths
NAMES = {
    laws.PIVOTED: "LU, pivoted",
    **{
        name: "LU, rows " + " ".join("xzφ"[row] for row in rows)
        for name, rows in PLAIN.items()
    },
    laws.QR: "QR of J",
    laws.QR_TRANSPOSED: "QR of Jᵀ",
    laws.GAUSSIAN: "Gaussian model",
}
QUANTITIES = {
    "sigma_b": "Σ_ω and σ_B",
    "alpha_u": "with (α, u)",
    "small_difference": "with small difference",
}
PHI_LATER = [name for name, rows in PLAIN.items() if rows[0] != 2]
# in the page's table
SHOWN = (
    laws.PIVOTED,
    "lu_xzp",
    "lu_zxp",
    laws.QR,
    laws.QR_TRANSPOSED,
)


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables."""
    stated = laws.published_values()
    chunks = trials(
        settings,
        "which_decomposition: paths",
        widths_of_chunk,
        range(options.chunks),
        chain=arm_of(dataset_option(Robot, PAPER_ARM, "robot")).chain,
        options=options,
        stated=stated,
        seed=settings.seed,
    )
    drawn = {}
    for time_law in chunks[0]:
        drawn[time_law] = np.concatenate([chunk[time_law] for chunk in chunks])

    widths = []
    evidence = []
    for time_law, paths in drawn.items():
        widths.append(laws.width_rows(paths, stated).assign(prior=time_law))
    for prior, paths in priors(drawn, options.least_norm).items():
        rows = laws.evidence_rows(paths, stated, options.tolerances, options.span)
        evidence.append(rows.assign(prior=prior))
    return {
        "evidence": concatenate(evidence),
        "widths": concatenate(widths),
        "unsquared": laws.unsquared_rows(drawn[RAMPED], stated, options.tolerances),
    }


def priors(drawn: Mapping[str, np.ndarray], least_norm: float) -> dict[str, np.ndarray]:
    """Return by prior the widths of its paths, which are ``drawn`` by time law."""
    ramped = drawn[RAMPED]
    result = {RAMPED: ramped}
    for kind in KINDS:
        result[f"{kind}s only"] = ramped[ramped["kind"] == kind]
    near = f"greatest ‖J⁻¹‖ above {least_norm:g}"
    result[near] = ramped[ramped["norm"] > least_norm]
    result[FULL_SPEED] = drawn[FULL_SPEED]
    return result


def widths_of_chunk(
    chunk: int,
    chain: PlanarChain,
    options: SimpleNamespace,
    stated: Published,
    seed: int,
) -> dict[str, np.ndarray]:
    """Return the widths by time law, on paths of the arm with a last link of random length."""
    stream = rng.stream(seed, "which_decomposition", chunk)
    links = chain.links.copy()
    still = (0.0, 0.0)
    links[-1] *= stream.uniform(*options.tool) / chain.lengths[-1]
    chain = replace(chain, links=links)
    full = TimeLaw(STEPS, RATE, still, still, (1.0, 1.0), options.once)
    ramped = TimeLaw(STEPS, RATE, options.rest, options.ramp, options.peak)
    timed = {
        RAMPED: (ramped, options.paths),
        FULL_SPEED: (full, options.full_speed_paths),
    }
    widths = {}
    for name, (law, count) in timed.items():
        paths = {}
        for kind in KINDS:
            paths[kind] = draw_paths(chain, law, kind, stated.u, count, stream)
        of_kinds = [laws.widths(chain, paths[kind], stated, kind) for kind in KINDS]
        widths[name] = np.concatenate(of_kinds)
    return widths


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    evidence = tables["evidence"]
    widths = tables["widths"]
    integrated = evidence[evidence["tolerance"] == laws.INTEGRATED]
    rows = rows_of_first(integrated, "size")
    later = rows[rows["reading"].isin(PHI_LATER)]
    best = {}
    for name, words in QUANTITIES.items():
        on_ramps = rows_of_first(later[later["quantities"] == name], "prior")
        best[words] = on_ramps.loc[on_ramps["likelihood"].idxmax()]

    choices = []
    for size, of_size in integrated.groupby("size", sort=False):
        sets = rows_of_first(of_size, "prior").groupby("quantities")
        first = odds(sets.get_group("sigma_b"), PHI_LATER)
        last = odds(sets.get_group("small_difference"), PHI_LATER)
        choices.append(f"{size} {first}, with all quantities {last}")

    by_reading = widths.set_index(["reading", "prior"])
    reached = by_reading.loc[laws.GAUSSIAN, "reached"]
    ramped, constant = (f"{100 * share:.2g} %" for share in reached)
    undecided = later["likelihood"].min() < 1 < later["likelihood"].max()
    sizes = rows_of_first(evidence, "size")
    counts = widths.groupby("prior", sort=False)["paths"].first()
    return {
        "verb": "do not determine" if undecided else "favour one side of",
        "later": odds(later, PHI_LATER),
        "best": best,
        "names": NAMES,
        "odds": odds(rows, [laws.QR]),
        "control": odds(rows, [laws.QR_TRANSPOSED]),
        "widest": number(by_reading.loc[laws.QR_TRANSPOSED, "best"].iloc[0]),
        "counts": [number(count) for count in counts],
        "tolerances": sorted({*evidence["tolerance"]} - {laws.INTEGRATED}),
        "shown": {name: sizes[sizes["reading"] == name] for name in SHOWN},
        "quantities": QUANTITIES,
        "choices": "; ".join(choices),
        "ramped": ramped,
        "constant": constant,
        "least": number(by_reading.loc[laws.PIVOTED, "least_ratio"].min()),
        "post": tables["unsquared"].iloc[-1],
    }


def rows_of_first(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return the rows with the first row's value of ``column``."""
    return rows[rows[column] == rows[column].iloc[0]]


def odds(rows: pd.DataFrame, readings: list[str]) -> str:
    """Return the least and the greatest likelihood of ``readings`` as odds (3:1 or 1:3)."""
    ends = rows[rows["reading"].isin(readings)]["likelihood"].agg(["min", "max"])
    return " to ".join(
        f"{number(x)}:1" if x >= 1 else f"1:{number(1 / x)}" for x in ends
    )


def draw(widths: pd.DataFrame, evidence: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    of_first_prior = rows_of_first(widths, "prior").set_index("reading")
    place = {reading: height for height, reading in enumerate(of_first_prior.index)}
    figure, (both,) = style.panels(
        style.TWO_COLUMNS,
        0.27 * len(place) + 0.95,
        columns=2,
        sharey=True,
        width_ratios=(1, 1.25),
    )
    left, right = both
    draw_widths(left, of_first_prior)
    integrated = evidence[evidence["tolerance"] == laws.INTEGRATED]
    draw_likelihoods(right, rows_of_first(integrated, "size"), place)
    names = NAMES | {laws.QR_TRANSPOSED: r"QR of J$^\mathsf{T}$"}
    left.set_yticks(list(place.values()), [names[reading] for reading in place])
    style.letters(both)
    for axes in both:
        axes.set_xscale("log")
        axes.axvline(1, color=style.GREY, linewidth=0.8, zorder=0)
        axes.tick_params(axis="y", length=0)
    figure.legend(
        loc="outside lower center",
        ncols=5,
        columnspacing=1.2,
        handlelength=1.4,
    )
    return figure


def draw_widths(axes: Axes, widths: pd.DataFrame) -> None:
    """Draw median and interval of the widths of each reading, with an arrow beyond WIDEST."""
    line = {"color": style.BLACK, "linewidth": 1.2}
    dot = {"color": style.BLACK, "marker": "o", "markersize": 4}
    arrow = dot | {"marker": ">", "clip_on": False}
    for height, row in enumerate(widths.itertuples()):
        end = min(row.high, WIDEST)
        axes.hlines(height, row.low, end, **line)
        axes.plot(row.median, height, **dot)
        if row.high > WIDEST:
            axes.plot(WIDEST, height, **arrow)
    axes.plot([], [], **dot, label="median, 90 % of the paths")
    axes.plot([], [], color=style.GREY, label="printed value; pivoted LU")
    axes.set(xlim=(0.02, WIDEST), ylim=(len(widths) - 0.5, -0.6))
    axes.set_xlabel("standard deviation over printed one (1)")


def draw_likelihoods(
    axes: Axes,
    evidence: pd.DataFrame,
    place: Mapping[str, int],
) -> None:
    """Draw the likelihoods at the height ``place`` of each reading: a mark for the first prior, a
    line over all priors, for each set of quantities.
    """
    labels = {
        "sigma_b": r"$\Sigma_\omega$ and $\sigma_B$",
        "alpha_u": r"with ($\alpha$, $u$)",
    }
    looks = {
        "sigma_b": (-0.22, {"marker": "o", "color": style.BLUE}),
        "alpha_u": (0.0, {"marker": "s", "color": style.ORANGE}),
        "small_difference": (0.22, {"marker": "D", "color": style.VERMILLION}),
    }
    for name, (shift, look) in looks.items():
        rows = evidence[evidence["quantities"] == name]
        heights = rows["reading"].map(place) + shift
        ends = rows.groupby(heights.round(6))["likelihood"].agg(["min", "max"])
        line = {"color": look["color"], "linewidth": 1.2}
        axes.hlines(ends.index, ends["min"], ends["max"], **line)
        first = rows_of_first(rows, "prior")
        label = labels.get(name, QUANTITIES[name])
        marks = look | {"label": label, "linestyle": "", "markersize": 4}
        axes.plot(first["likelihood"], heights[first.index], **marks)
    axes.set(xlim=(1e-3, 1e3), xlabel="likelihood over pivoted LU's (1)")
