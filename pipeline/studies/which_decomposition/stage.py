"""which_decomposition: decompositions of the Jacobian that agree with the paper's numbers."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import Chain, PlanarChain
from pipeline.arm.model import arm_of, chain_of
from pipeline.core import rng
from pipeline.core.options.dataset import Robot
from pipeline.figures import style
from pipeline.studies.frame import Tables, concatenate, dataset_option, number, trials
from pipeline.studies.which_decomposition import evidence as laws
from pipeline.studies.which_decomposition.evidence import PLAIN, Published
from pipeline.studies.which_decomposition.paths import KINDS, TimeLaw, draw_paths
from pipeline.verdicts.claims import read_claims

STEPS, RATE = 320, 100.0  # M and steps a second of the paper
RAMPED, FULL_SPEED = "ramps and rest", "constant full speed"
PAPER_ARM, SPACE_ARM = "youbot", "ur5"  # independent of the run's dataset
GENERAL = (laws.PIVOTED, laws.QR, laws.QR_TRANSPOSED)  # readings for a task of any size
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
SHOWN = (
    laws.PIVOTED,
    "lu_xzp",
    "lu_zxp",
    laws.QR,
    laws.QR_TRANSPOSED,
)  # in the page's table


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables."""
    stated = laws.published_values(read_claims())
    common = {
        "chain": arm_of(dataset_option(Robot, PAPER_ARM, "robot")).chain,
        "options": options,
    }
    common |= {"stated": stated, "seed": settings.seed}
    label = "which_decomposition: paths"
    chunks = trials(settings, label, widths_of_chunk, range(options.chunks), **common)
    drawn = {
        name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]
    }
    ramped = drawn[RAMPED]
    near = f"greatest ‖J⁻¹‖ above {options.least_norm:g}"
    priors = {
        RAMPED: ramped,
        **{f"{kind}s alone": ramped[ramped["kind"] == kind] for kind in KINDS},
    }
    priors |= {
        near: ramped[ramped["norm"] > options.least_norm],
        FULL_SPEED: drawn[FULL_SPEED],
    }
    likelihoods = [
        laws.evidence_rows(part, stated, options.tolerances, options.span).assign(
            prior=name
        )
        for name, part in priors.items()
    ]
    q = np.linspace(options.start, options.end, options.poses)
    space = chain_of(dataset_option(Robot, SPACE_ARM, "robot"))
    return {
        "evidence": concatenate(likelihoods),
        "widths": concatenate(
            laws.width_rows(x, stated).assign(prior=n) for n, x in drawn.items()
        ),
        "unsquared": laws.unsquared_rows(ramped, stated, options.tolerances),
        "units": unit_rows(space, q, options.turns, stated.sigma_b),
    }


def widths_of_chunk(
    chunk: int,
    chain: PlanarChain,
    options: SimpleNamespace,
    stated: Published,
    seed: int,
) -> dict[str, np.ndarray]:
    """Return the widths by time law, on paths of the arm with a last link of random length."""
    stream, parts = rng.stream(seed, "which_decomposition", chunk), {}
    links, still = chain.links.copy(), (0.0, 0.0)
    links[-1] *= stream.uniform(*options.tool) / chain.lengths[-1]
    chain = replace(chain, links=links)
    full = TimeLaw(STEPS, RATE, still, still, (1.0, 1.0), options.once)
    ramped = TimeLaw(STEPS, RATE, options.rest, options.ramp, options.peak)
    timed = {
        RAMPED: (ramped, options.paths),
        FULL_SPEED: (full, options.full_speed_paths),
    }
    for name, (law, count) in timed.items():
        drawn = {
            kind: draw_paths(chain, law, kind, stated.u, count, stream)
            for kind in KINDS
        }
        widths = [
            laws.widths(chain, paths, stated, kind) for kind, paths in drawn.items()
        ]
        parts[name] = np.concatenate(widths)
    return parts


def unit_rows(
    chain: Chain, q: np.ndarray, turns: list[float], sigma_b: float
) -> pd.DataFrame:
    """Return the table ``units`` at equally spaced poses ``q`` (K, n) of an arm in space: noise in
    other units, and in axes turned about z by ``turns`` in degrees.
    """
    jacobian, step = chain.jacobian(q), q[1] - q[0]
    cases = [("m", 0.0, np.eye(6)), ("mm", 0.0, np.diag([1000.0] * 3 + [1.0] * 3))]
    for degrees in turns:
        turn = Rotation.from_euler("z", -degrees, degrees=True).as_matrix()
        cases.append(("m", degrees, np.kron(np.eye(2), turn)))
    nominal, rows = np.matvec(chain.inverse_jacobian(q), np.matvec(jacobian, step)), []
    for (unit, degrees, change), reading in product(cases, GENERAL):
        v = np.matvec(change @ jacobian, step)
        variance = laws.wishart_variance(reading, change @ jacobian, v, sigma_b)
        rows.append(
            (reading, unit, degrees, np.sqrt(variance.sum() / np.sum(nominal**2)))
        )
    return pd.DataFrame(rows, columns=["reading", "unit", "turn", "noise"])


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    evidence, widths, units = tables["evidence"], tables["widths"], tables["units"]
    integrated = evidence[evidence["tolerance"] == 0]
    rows, best, choices = rows_of_first(integrated, "size"), {}, []
    later = rows[rows["reading"].isin(PHI_LATER)]
    for name, words in QUANTITIES.items():
        part = rows_of_first(later[later["quantities"] == name], "prior")
        best[words] = part.loc[part["likelihood"].idxmax()]
    for size, part in integrated.groupby("size", sort=False):
        sets = rows_of_first(part, "prior").groupby("quantities")
        first, last = (
            odds(sets.get_group(x), PHI_LATER) for x in ("sigma_b", "small_difference")
        )
        choices.append(f"{size} {first}, with all quantities {last}")
    by, sizes = widths.set_index(["reading", "prior"]), rows_of_first(evidence, "size")
    ramped, constant = (
        f"{100 * share:.2g} %" for share in by.loc[laws.GAUSSIAN, "reached"]
    )
    below, above = later["likelihood"].min() < 1, later["likelihood"].max() > 1
    still = units[units["turn"] == 0].pivot(
        index="reading", columns="unit", values="noise"
    )
    return (still["mm"] / still["m"]).to_dict() | {
        "verb": "do not determine" if below and above else "favour one side of",
        "later": odds(later, PHI_LATER),
        "best": best,
        "names": NAMES,
        "odds": odds(rows, [laws.QR]),
        "control": odds(rows, [laws.QR_TRANSPOSED]),
        "widest": number(by.loc[laws.QR_TRANSPOSED, "best"].iloc[0]),
        "counts": [
            number(n) for n in widths.groupby("prior", sort=False)["paths"].first()
        ],
        "tolerances": sorted({*evidence["tolerance"]} - {laws.INTEGRATED}),
        "shown": {name: sizes[sizes["reading"] == name] for name in SHOWN},
        "quantities": QUANTITIES,
        "choices": "; ".join(choices),
        "ramped": ramped,
        "constant": constant,
        "least": number(by.loc[laws.PIVOTED, "least_ratio"].min()),
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
    main, limits = rows_of_first(widths, "prior").set_index("reading"), (0.02, 30)
    place = {reading: height for height, reading in enumerate(main.index)}
    layout = {"columns": 2, "sharey": True, "width_ratios": (1, 1.25)}
    figure, (both,) = style.panels(
        style.TWO_COLUMNS, 0.27 * len(place) + 0.95, **layout
    )
    (left, right), dot = both, {"color": style.BLACK, "marker": "o", "markersize": 4}
    for height, row in enumerate(main.itertuples()):
        left.hlines(
            height, row.low, min(row.high, limits[1]), color=style.BLACK, linewidth=1.2
        )
        left.plot(row.median, height, **dot)
        if row.high > limits[1]:
            left.plot(limits[1], height, **dot | {"marker": ">"}, clip_on=False)
    rows = rows_of_first(evidence[evidence["tolerance"] == 0], "size")
    labels = {
        "sigma_b": r"$\Sigma_\omega$ and $\sigma_B$",
        "alpha_u": r"with ($\alpha$, $u$)",
    }
    looks = (("o", style.BLUE), ("s", style.ORANGE), ("D", style.VERMILLION))
    for shift, name, (marker, color) in zip(
        (-0.22, 0, 0.22), QUANTITIES, looks, strict=True
    ):
        part = rows[rows["quantities"] == name]
        heights = part["reading"].map(place) + shift
        ends = part.groupby(heights.round(6))["likelihood"].agg(["min", "max"])
        right.hlines(ends.index, ends["min"], ends["max"], color=color, linewidth=1.2)
        here = rows_of_first(part, "prior")
        look = {
            "marker": marker,
            "color": color,
            "label": labels.get(name, QUANTITIES[name]),
        }
        right.plot(
            here["likelihood"], heights[here.index], linestyle="", markersize=4, **look
        )
    left.plot([], [], **dot, label="median, 90 % of the paths")
    left.plot([], [], color=style.GREY, label="printed value; pivoted LU")
    names = NAMES | {laws.QR_TRANSPOSED: r"QR of J$^\mathsf{T}$"}
    left.set_yticks(list(place.values()), [names[reading] for reading in place])
    left.set(xlim=limits, ylim=(len(place) - 0.5, -0.6))
    left.set_xlabel("standard deviation over printed one (1)")
    right.set(xlim=(1e-3, 1e3), xlabel="likelihood over pivoted LU's (1)")
    style.letters(both)
    for axes in both:
        axes.set_xscale("log")
        axes.axvline(1, color=style.GREY, linewidth=0.8, zorder=0)
        axes.tick_params(axis="y", length=0)
    figure.legend(
        loc="outside lower center", ncols=5, columnspacing=1.2, handlelength=1.4
    )
    return figure
