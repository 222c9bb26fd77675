"""Figures of the wrench of cooperating robots (Secs. 3.2 and 4.2)."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon

from pipeline.core.options.dataset import Arrangement
from pipeline.figures import style

# lengths of the schematic, without a scale, chosen so that no label touches a line
CORNERS = np.array([[2.0, 1.1], [-2.0, 1.1], [-2.0, -1.1], [2.0, -1.1]])
TILT = np.radians(10)
CABLES = (  # attachment; direction (degrees) and length of the tension, nominal and perturbed
    (CORNERS[0], (38, 2.4), (56, 3.0)),
    (CORNERS[1], (142, 2.7), (124, 2.3)),
    (CORNERS[3], (292, 2.3), (274, 2.8)),
)
STATES = (  # symbol, radius of the angle's arc, line
    (r"\underline{{{}}}_{}", 0.65, {"color": style.BLUE, "linestyle": "-"}),
    (r"\boldsymbol{{{}}}_{}", 1.25, {"color": style.VERMILLION, "linestyle": "--"}),
)
CENTRED = {"ha": "center", "va": "center"}
BINS = 60  # of the histograms
ROBOTS = 1.45  # distance of the robots' circles from the platform, in greatest tensions
LINES = {
    "measured": style.RECORDED,
    "modelled": {"label": "matrix model", "color": style.BLUE, "linestyle": "--"},
}
SHOWN = 0.005  # least density, as a share of the panel's greatest density, within the axis limits


def unit_vector(angle: float) -> np.ndarray:
    """Return the unit vector (2,) at an ``angle`` in rad."""
    return np.array([np.cos(angle), np.sin(angle)])


def cable_robot() -> Figure:
    """Draw Fig. (MotivFig), in the paper's notation."""
    figure, ((axes,),) = style.panels(style.ONE_COLUMN, 3.0)
    turn = np.array([[np.cos(TILT), -np.sin(TILT)], [np.sin(TILT), np.cos(TILT)]])
    outline = {"facecolor": "#EEEEEE", "edgecolor": style.BLACK, "linewidth": 0.8}
    axes.add_patch(Polygon(CORNERS @ turn.T, **outline))
    for origin, frame, names in (
        ([-4.3, -3.7], np.eye(2), "xy"),
        ([0.0, 0.0], turn, "uv"),
    ):
        for direction, name in zip(frame.T, names, strict=True):
            style.arrow(
                axes,
                origin,
                origin + 0.75 * direction,
                style.BLACK,
                arrowstyle="->",
            )
            axes.text(*(origin + 0.92 * direction), f"${name}$", **CENTRED)
    for i, (local, *states) in enumerate(CABLES, start=1):
        point = turn @ local
        style.arrow(axes, (0, 0), point, style.GREY)
        aside = np.array([-abs(point[1]), np.sign(point[1]) * point[0]]) / np.hypot(
            *point,
        )
        axes.text(*(0.36 * point + 0.28 * aside), f"$r_{i}$", **CENTRED)
        level = np.column_stack([point, point + np.array([1.6, 0])])
        axes.plot(*level, color=style.GREY, linestyle=":", linewidth=0.7)
        for (degrees, tension), (symbol, radius, line) in zip(
            states,
            STATES,
            strict=True,
        ):
            along = unit_vector(np.radians(degrees))
            color = line["color"]
            tip = point + tension * along
            axes.plot(*np.column_stack([point, tip]), **line)
            style.arrow(axes, tip, tip + 0.12 * along, color)
            size = {"width": 2 * radius, "height": 2 * radius, "theta2": degrees}
            axes.add_patch(Arc(point, **size, color=color, linewidth=0.7))
            # clear of the platform for a long arc
            middle = point + (radius + 0.3) * unit_vector(
                np.radians(min(degrees / 2, 70)),
            )
            for place, name in ((tip + 0.45 * along, "T"), (middle, r"\theta")):
                axes.text(*place, f"${symbol.format(name, i)}$", color=color, **CENTRED)
        axes.plot(*point, "o", color=style.BLACK, markersize=3)
    axes.set(aspect="equal", xlim=(-4.9, 4.7), ylim=(-4.1, 4.6))
    axes.set_axis_off()
    return figure


def wrench_error_histograms(wrench_errors: pd.DataFrame) -> Figure:
    """Draw Fig. (ErrWrnRMT): one histogram per number of cables, all on the same bins."""
    percent = 100 * wrench_errors["error"]
    edges = np.linspace(0, percent.max(), BINS + 1)
    groups = percent.groupby(wrench_errors["agents"])
    colors = mpl.colormaps["viridis"](np.linspace(0, 0.9, len(groups)))
    figure, ((axes,),) = style.panels(style.ONE_COLUMN, 2.5)
    for color, (agents, errors) in zip(colors, groups, strict=True):
        look = {
            "histtype": "stepfilled",
            "facecolor": (*color[:3], 0.15),
            "edgecolor": color,
        }
        label = (
            f"$m$ = {agents}: mean {errors.mean():.1f}, greatest {errors.max():.1f} %"
        )
        axes.hist(errors, edges, **look, linewidth=0.9, label=label)
    axes.set(xlabel="relative error of the variances (%)", ylabel="number of systems")
    axes.set_xlim(0, edges[-1])
    axes.legend(loc="upper right")
    return figure


def wrench_density(
    force_density: pd.DataFrame,
    configurations: Mapping[str, Arrangement],
    recordings: str,
) -> Figure:
    """Draw Fig. (WrenchExprmnt): one range and one colour scale for all ``configurations``."""
    layout = {"rows": len(configurations), "columns": 3, "width_ratios": (1.3, 1, 1)}
    figure, grid = style.panels(
        style.TWO_COLUMNS,
        0.4 + 1.75 * layout["rows"],
        **layout,
    )
    tension = max(max(robots.tension) for robots in configurations.values())
    limits = [(force_density[c].min(), force_density[c].max()) for c in ("fx", "fy")]
    shades = {"cmap": "CMRmap_r", "vmin": 0, "vmax": force_density["density"].max()}
    cross = {"color": style.SKY, "markersize": 6, "markeredgewidth": 1.0}
    for row, (name, robots) in zip(grid, configurations.items(), strict=True):
        pulls = np.multiply(
            robots.tension,
            [np.cos(robots.direction), np.sin(robots.direction)],
        )
        _draw_robots(row[0], robots, pulls, ROBOTS * tension)
        row[0].set_title(style.plain_label(name), loc="left", fontweight="bold")
        density_rows = force_density[force_density["configuration"] == name]
        for axes, source in zip(row[1:], ("measured", "modelled"), strict=True):
            rows = density_rows[density_rows["source"] == source]
            density = rows.pivot(index="fy", columns="fx", values="density")
            cells = (density.columns, density.index, density.to_numpy())
            image = axes.pcolormesh(*cells, **shades, rasterized=True)
            axes.plot(*pulls.sum(axis=1), "+", **cross)
            axes.set(
                xlim=limits[0],
                ylim=limits[1],
                aspect="equal",
                anchor="N",
                ylabel="$F_y$ (N)",
            )
    for axes in grid[-1, 1:]:
        axes.set_xlabel("$F_x$ (N)")
    for axes, title in zip(
        grid[0],
        ("robots", recordings, "matrix model"),
        strict=True,
    ):
        axes.set_title(title)
    figure.colorbar(
        image,
        ax=grid[:, 1:],
        label="density (N$^{-2}$)",
        shrink=0.5,
        aspect=30,
    )
    return figure


def _draw_robots(
    axes: Axes,
    robots: Arrangement,
    pulls: np.ndarray,
    far: float,
) -> None:
    """Draw cables from the platform to the robots, and the robots' forces ``pulls`` (2, m) in N."""
    circle = {
        "color": style.GREY,
        "markersize": 13,
        "markerfacecolor": "white",
        "zorder": 2,
    }
    cables = zip(robots.direction, robots.tension, pulls.T, strict=True)
    for i, (direction, tension, pull) in enumerate(cables, start=1):
        robot = far * unit_vector(direction)
        axes.plot(
            *np.column_stack([(0, 0), robot]),
            color=style.GREY,
            linewidth=0.8,
            zorder=1,
        )
        axes.plot(*robot, "o", **circle)
        axes.text(*robot, str(i), **CENTRED)
        label = rf"$\underline{{T}}_{i}$ = {tension:.2f} N" + "\n"
        label += rf"$\underline{{\theta}}_{i}$ = {direction:.2f} rad"
        side, alignment = (1, "left") if robot[0] >= 0 else (-1, "right")
        place = {
            "xytext": (10 * side, 0),
            "textcoords": "offset points",
            "ha": alignment,
        }
        axes.annotate(label, robot, **place, va="center", fontsize=7)
        style.arrow(axes, (0, 0), pull, style.BLUE, linewidth=1.2)
    style.arrow(axes, (0, 0), pulls.sum(axis=1), style.BLACK, linewidth=1.2)
    axes.set(
        xlim=(-2 * far, 2 * far),
        ylim=(-1.2 * far, 1.2 * far),
        aspect="equal",
        anchor="N",
    )
    axes.set_axis_off()


def wrench_marginals(wrench_marginals: pd.DataFrame, recordings: str) -> Figure:
    """Draw a row of panels for each configuration, a panel for each force and moment."""
    rows = list(wrench_marginals["row"].unique())
    by_name = list(wrench_marginals.groupby("configuration", sort=False))
    layout = {"rows": len(by_name), "columns": len(rows)}
    figure, grid = style.panels(style.TWO_COLUMNS, 0.5 + 1.15 * len(by_name), **layout)
    for line, (name, table) in zip(grid, by_name, strict=True):
        for axes, row in zip(line, rows, strict=True):
            curves = table[table["row"] == row]
            shown = curves[curves["density"] > SHOWN * curves["density"].max()]
            for source, look in LINES.items():
                curve = curves[curves["source"] == source]
                axes.plot(
                    curve["value"],
                    curve["density"],
                    **{"label": recordings} | look,
                )
            label = f"$F_{row[1]}$ (N)" if row[0] == "f" else rf"$M_{row[1]}/\ell$ (N)"
            axes.set(xlabel=label, ylim=(0, None), yticks=[])
            if len(shown):
                axes.set_xlim(shown["value"].min(), shown["value"].max())
            axes.locator_params(axis="x", nbins=3)
        line[0].set_title(style.plain_label(name), loc="left", fontweight="bold")
        line[0].set_ylabel("density (1/N)")
    style.legend(figure, ncols=2)
    return figure
