"""The verdicts that change, the page of the study and its figure."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.cases.readings import FAILS, HOLDS, UNKNOWN
from pipeline.figures import style
from pipeline.studies.frame import MISSING, Tables
from pipeline.studies.robustness.grid import BASE, CHANCE
from pipeline.verdicts.wording import table

BOTH = "both"
NAMES = {
    "lasting": "duration of deviations",
    "kappa": "concentration of cables",
    "tension_std": "tension std of cables",
    "floor": r"floor of $B^{-1}$",
    "weights": r"weights $\alpha_2/\alpha_1$",
}


def verdict_of(holds: int, fails: int) -> str:
    """Return the verdict of the cases of a level, of which so many hold and fail."""
    return {(1, 1): BOTH, (1, 0): HOLDS, (0, 1): FAILS, (0, 0): UNKNOWN}[holds > 0, fails > 0]


def changes(robustness: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each grid, factor and claim: the ``base`` verdict, and whether a level of
    the factor has another one. Other seeds of the base condition count as the factor CHANCE.
    """
    rows = robustness.assign(verdict=list(map(verdict_of, robustness.holds, robustness.fails)))
    first = rows[rows["factor"] == BASE].rename(columns={"verdict": "base"})
    rows = rows.merge(first[["grid", "claim", "base"]], on=["grid", "claim"], how="left")
    base = rows["factor"] == BASE
    rows["changed"] = (rows["verdict"] != rows["base"]).where(~base, rows["verdict"] == BOTH)
    lucky = rows[base & (rows["grid"] != "decisions")].assign(factor=CHANCE)
    keys = ["grid", "claim", "about", "base", "factor"]
    varied = pd.concat([rows[~base], lucky])
    return varied.groupby(keys, sort=False)["changed"].any().reset_index()


def facts(tables: Tables, options: object) -> dict[str, object]:
    """Return the fields of the page."""
    changed = changes(tables["robustness"])
    chance, open_ones = changed["factor"] == CHANCE, changed["grid"] == "decisions"
    flipped = changed["changed"]
    lucky = set(changed["claim"][flipped & chance])
    physical = set(changed["claim"][flipped & ~open_ones & ~chance])
    decisions = changed[flipped & open_ones & ~chance]
    most = decisions.groupby("factor")["claim"].nunique().sort_values(ascending=False)
    steady, rows = [], []
    for claim, own in changed.groupby("claim", sort=False):
        if not own["changed"].any():
            steady.append(claim)
            continue
        cells = [f"{claim} †" if claim in lucky else claim, ", ".join(dict.fromkeys(own["base"]))]
        for part in (open_ones, ~open_ones):
            some = own[(part & ~chance)[own.index]]
            cells.append(f"{some['changed'].sum()} of {len(some)}" if len(some) else MISSING)
        rows.append(cells)
    decision = "The decision that changes most is “{}”: {} claims. "
    return {
        "claims": changed["claim"].nunique(),
        "steady": len(steady),
        "decisions": decisions["claim"].nunique(),
        "physical": len(physical),
        "lucky": len(lucky),
        "most": decision.format(most.index[0], most.iloc[0]) if len(most) else "",
        "filtered": options.filtered,
        "seeds": len(options.seeds),
        "table": table(["claim", "base", "decisions", "laboratory"], rows),
        "names": ", ".join(steady) or "none",
    }


def draw(robustness: pd.DataFrame) -> Figure:
    """Claims whose verdict changes, by what is decided otherwise.

    A row is a claim, a column a decision that the paper leaves open (left) or a factor of the
    laboratory (right). First column of either part: verdict in the base case (disc: holds; cross:
    fails; diamond: both, over the seeds; dash: no evidence). Filled square: at least one level has
    another verdict; open square: no level has; nothing: the claim has no evidence there. Orange
    squares in the column of random numbers mark claims that chance alone changes. An asterisk marks
    claims about robots or about the paper's specimen, which synthetic recordings do not decide.
    """
    bases = {
        HOLDS: {"marker": "o", "color": style.BLUE},
        FAILS: {"marker": "X", "color": style.BLACK},
        BOTH: {"marker": "D", "color": style.GREY},
        UNKNOWN: {"marker": "_", "color": style.GREY},
    }
    square = {"marker": "s", "ls": "none", "ms": 4.2, "mew": 0.5}
    squares = {
        "same verdict": square | {"mfc": "none", "mec": style.LIGHT_GREY},
        "another verdict": square | {"mfc": style.BLUE, "mec": style.BLUE},
        "changed by chance": square | {"mfc": style.VERMILLION, "mec": style.VERMILLION},
    }
    same, other, luck = squares.values()
    changed = changes(robustness)
    parts = changed["grid"].where(changed["grid"] == "decisions", "laboratory")
    parts = dict(list(changed.groupby(parts, sort=False)))
    claims = changed.drop_duplicates("claim").set_index("claim")["about"]
    columns = {part: ["base case", *dict.fromkeys(rows["factor"])] for part, rows in parts.items()}
    widths = [len(names) for names in columns.values()]
    size = {"columns": len(parts), "sharey": True, "width_ratios": widths}
    figure, grid = style.panels(style.TWO_COLUMNS, 1.9 + 0.135 * len(claims), **size)
    place = {claim: y for y, claim in enumerate(claims.index)}
    for axes, (part, rows) in zip(grid[0], parts.items(), strict=True):
        names = columns[part]
        for row in rows.drop_duplicates("claim").itertuples():
            axes.plot([0], [place[row.claim]], ls="none", ms=4.2, **bases[row.base])
        for row in rows.itertuples():
            look = (luck if row.factor == CHANCE else other) if row.changed else same
            axes.plot([names.index(row.factor)], [place[row.claim]], **look)
        labels = [NAMES.get(name, name.replace("_", " ")) for name in names]
        axes.set_xticks(range(len(names)), labels, rotation=90)
        axes.set(xlim=(-0.7, len(names) - 0.3), ylim=(len(claims) - 0.4, -0.6), title=part)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
    labels = [name.replace("-", " ") + " *" * (about != "method") for name, about in claims.items()]
    grid[0, 0].set_yticks(range(len(claims)), labels, fontsize=7)
    entries = [Line2D([], [], ls="none", label=name, **look) for name, look in bases.items()]
    entries += [Line2D([], [], label=name, **look) for name, look in squares.items()]
    figure.legend(handles=entries, loc="outside lower center", ncols=7, columnspacing=1.0)
    return figure
