"""One test take to be played: plots whose moving parts a slider sets, drawn by Plotly, and what they are set to at each frame."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from pipeline.figures.style import BLACK, GREY, ORANGE, RECORDED, VERMILLION, model_lines
from pipeline.report.illustrations import data_address

PAIRS = ((1, 2), (2, 3))  # joints whose joint spread is shown
AROUND = np.linspace(0, 2 * np.pi, 37)
DASHES = {"-": "solid", ":": "dot", "--": "dash", "-.": "dashdot"}
MILLI = 1e3  # deviations are shown in mrad


def library() -> str:
    """Plotly's code as it stands in the page."""
    return get_plotlyjs()


def player(frames: pd.DataFrame, posteriors: pd.DataFrame, images: Sequence[bytes]) -> dict:
    """What the page's script plays: tables ``played_frames`` and ``played_posteriors``, and the image (PNG) of every frame.

    ``figures`` by the id of the element they are drawn in; ``frames``, for each the image, the links and the ellipses; ``models`` by name.
    """
    lines = model_lines(list(dict.fromkeys(posteriors["model"])))
    by_model = {model: posteriors[posteriors["model"] == model].reset_index(drop=True) for model in lines}
    addresses = [data_address("image/png", image) for image in images]
    truth = next(iter(by_model.values()))
    measured = np.column_stack([frames[f"q{j}"] - np.interp(frames["t"], truth["t"], truth[f"q{j}"]) for j in (1, 2, 3)])
    at = np.searchsorted(truth["t"], frames["t"].clip(truth["t"].iloc[0], truth["t"].iloc[-1]) - 1e-9)
    ellipses = {model: [_ellipses(rows.iloc[k]) for k in at] for model, rows in by_model.items()}
    reach = _reach([frame for of_model in ellipses.values() for frame in of_model])
    largest = max(_largest(rows) for rows in by_model.values())
    figures = {"play-depth": _depth(frames, addresses[0]), "play-joints": _joints(frames, by_model, lines)}
    for model, rows in by_model.items():
        figures[f"play-error-{model}"] = _errors(rows, frames, measured, lines[model], largest)
        figures[f"play-spread-{model}"] = _spread(ellipses[model][0], measured[0], lines[model], reach)
    return {
        "take": frames["take"].iloc[0],
        "models": {model: line["label"] for model, line in lines.items()},
        "figures": {name: json.loads(figure.to_json()) for name, figure in figures.items()},
        "frames": [
            {
                "t": round(float(row["t"]), 4),
                "image": image,
                "u": _short(row[[f"u{node}" for node in range(4)]]),
                "v": _short(row[[f"v{node}" for node in range(4)]]),
                "measured": _short(MILLI * of_frame),
                "models": {model: _values(by_model[model].iloc[k]) | {"ellipses": ellipses[model][i]} for model in lines},
            }
            for i, ((_, row), image, of_frame, k) in enumerate(zip(frames.iterrows(), addresses, measured, at, strict=True))
        ],
    }


def _short(values: Sequence[float]) -> list[float]:
    return [round(float(value), 3) for value in values]


def _values(row: pd.Series) -> dict:
    """Error and bound of every joint in mrad, and the effective number of particles."""
    error = [MILLI * (row[f"m{j}"] - row[f"q{j}"]) for j in (1, 2, 3)]
    return {"error": _short(error), "bound": _short(MILLI * np.sqrt([row[f"c{j}{j}"] for j in (1, 2, 3)])), "ess": round(float(row["ess"]))}


def _ellipses(row: pd.Series) -> list[list[list[float]]]:
    """For each pair of joints the outlines of one and of two standard deviations about the mean: [x, y] each, mrad from the truth."""
    circle = np.stack([np.cos(AROUND), np.sin(AROUND)])
    found = []
    for i, j in PAIRS:
        variances, axes = np.linalg.eigh(np.array([[row[f"c{i}{i}"], row[f"c{i}{j}"]], [row[f"c{i}{j}"], row[f"c{j}{j}"]]]))
        outline = axes @ (np.sqrt(np.maximum(variances, 0))[:, None] * circle)
        middle = np.array([[row[f"m{i}"] - row[f"q{i}"]], [row[f"m{j}"] - row[f"q{j}"]]])
        # a gap between the two outlines, so that they are one line
        both = np.concatenate([middle + outline, np.full((2, 1), np.nan), middle + 2 * outline], axis=1)
        found.append([[None if np.isnan(value) else round(float(MILLI * value), 2) for value in axis] for axis in both])
    return found


def _largest(rows: pd.DataFrame) -> float:
    """mrad that errors and twice their bounds stay within but for a hundredth of the steps."""
    sizes = [np.maximum(abs(rows[f"m{j}"] - rows[f"q{j}"]), 2 * np.sqrt(rows[f"c{j}{j}"])) for j in (1, 2, 3)]
    return float(MILLI * np.quantile(np.concatenate(sizes), 0.99))


def _framed(figure: go.Figure, height: int, **layout: object) -> go.Figure:
    margins = {"l": 56, "r": 8, "t": 26, "b": 40}
    figure.update_layout(template="simple_white", height=height, margin=margins, font={"size": 12}, dragmode=False, **layout)
    return figure.update_xaxes(fixedrange=True).update_yaxes(fixedrange=True)


def _cursor(figure: go.Figure, t: float) -> go.Figure:
    """The line that the slider moves."""
    return figure.add_shape(type="line", x0=t, x1=t, y0=0, y1=1, yref="paper", opacity=1, line={"color": BLACK, "width": 1})


def _dash(line: dict) -> str:
    return DASHES.get(line["linestyle"], "longdashdot") if isinstance(line["linestyle"], str) else "longdashdot"


def _depth(frames: pd.DataFrame, image: str) -> go.Figure:
    first = frames.iloc[0]
    width, height = int(first["width"]), int(first["height"])
    links = {"x": _short(first[[f"u{n}" for n in range(4)]]), "y": _short(first[[f"v{n}" for n in range(4)]])}
    look = {
        "line": {"color": "#FFFFFF", "width": 3},
        "marker": {"color": VERMILLION, "size": 9, "line": {"color": "#FFFFFF", "width": 1.5}},
    }
    figure = go.Figure(go.Scatter(**links, **look, mode="lines+markers", text=["O1", "O2", "O3", "EE"], hoverinfo="text"))
    place = {"xref": "x", "yref": "y", "x": 0, "y": 0, "sizex": width, "sizey": height, "sizing": "stretch", "layer": "below"}
    figure.add_layout_image(source=image, **place)
    _framed(figure, 330, showlegend=False).update_layout(margin={"l": 0, "r": 0, "t": 0, "b": 0})
    figure.update_xaxes(range=[0, width], visible=False, constrain="domain")
    return figure.update_yaxes(range=[height, 0], visible=False, scaleanchor="x", constrain="domain")


def _joints(frames: pd.DataFrame, by_model: dict[str, pd.DataFrame], lines: dict[str, dict]) -> go.Figure:
    """The angles themselves: measured truth, depth camera, estimates."""
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    truth = next(iter(by_model.values()))
    for j in (1, 2, 3):
        shown = {"showlegend": j == 1, "row": j}
        _line(figure, truth["t"], truth[f"q{j}"], "motion capture", RECORDED["color"], "solid", width=3, **shown)
        marker = {"color": GREY, "size": 5, "symbol": "circle-open"}
        trace = go.Scatter(
            x=_short(frames["t"]), y=_short(frames[f"q{j}"]), mode="markers", marker=marker, name="depth camera", showlegend=j == 1
        )
        figure.add_trace(trace, row=j, col=1)
        for model, rows in by_model.items():
            line = lines[model]
            _line(figure, rows["t"], rows[f"m{j}"], line["label"], line["color"], _dash(line), **shown)
        figure.update_yaxes(title_text=f"q<sub>{j}</sub> (rad)", row=j, col=1)
    figure.update_xaxes(title_text="time (s)", row=3, col=1)
    legend = {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"}
    figure.update_xaxes(range=[0, float(truth["t"].iloc[-1])])
    return _cursor(_framed(figure, 430, legend=legend), float(frames["t"].iloc[0]))


def _line(
    figure: go.Figure, x: pd.Series, y: pd.Series, name: str, color: str, dash: str, row: int, showlegend: bool, width: float = 1.5
) -> None:
    line = {"color": color, "width": width, "dash": dash}
    trace = go.Scatter(
        x=_short(x), y=[round(float(v), 5) for v in y], mode="lines", name=name, legendgroup=name, line=line, showlegend=showlegend
    )
    figure.add_trace(trace, row=row, col=1)


def _errors(rows: pd.DataFrame, frames: pd.DataFrame, measured: np.ndarray, line: dict, largest: float) -> go.Figure:
    """The estimate minus the truth with bounds of one and two standard deviations, one joint below the other."""
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    t = _short(rows["t"])
    for j in (1, 2, 3):
        error, bound = MILLI * (rows[f"m{j}"] - rows[f"q{j}"]), MILLI * np.sqrt(rows[f"c{j}{j}"])
        for factor, colour in ((2, "#E4E4E4"), (1, "#B8B8B8")):
            band = {"x": t + t[::-1], "y": _short(error + factor * bound) + _short(error - factor * bound)[::-1]}
            trace = go.Scatter(**band, fill="toself", fillcolor=colour, line={"width": 0}, hoverinfo="skip", showlegend=False)
            figure.add_trace(trace, row=j, col=1)
        marker = {"color": ORANGE, "size": 4, "symbol": "circle-open"}
        seen = go.Scatter(x=_short(frames["t"]), y=_short(MILLI * measured[:, j - 1]), mode="markers", marker=marker, name="depth camera")
        figure.add_trace(seen, row=j, col=1)
        trace = go.Scatter(x=t, y=_short(error), mode="lines", name=line["label"], line={"color": line["color"], "width": 1.5})
        figure.add_trace(trace, row=j, col=1)
        figure.add_hline(0, opacity=1, line={"color": VERMILLION, "width": 1}, row=j, col=1)
        figure.update_yaxes(title_text=f"q<sub>{j}</sub> (mrad)", range=[-largest, largest], row=j, col=1)
    figure.update_xaxes(title_text="time (s)", row=3, col=1)
    figure.update_xaxes(range=[0, t[-1]])
    return _cursor(_framed(figure, 380, showlegend=False), float(frames["t"].iloc[0]))


def _reach(frames: list[list]) -> list[float]:
    """mrad that the ellipses of each pair of joints stay within, but for the greatest."""
    sizes = [[abs(value) for frame in frames for axis in frame[pair] for value in axis if value is not None] for pair in range(len(PAIRS))]
    return [float(np.quantile(of_pair, 0.97)) for of_pair in sizes]


def _spread(now: list, measured: np.ndarray, line: dict, reach: list[float]) -> go.Figure:
    """The particles' spread in two pairs of joints about the truth, which is the cross in the middle."""
    figure = make_subplots(rows=1, cols=2, horizontal_spacing=0.22)
    for place, (i, j) in enumerate(PAIRS, start=1):
        x, y = now[place - 1]
        outline = go.Scatter(x=x, y=y, mode="lines", line={"color": line["color"], "width": 2}, name="particles", connectgaps=False)
        point = {"x": [round(MILLI * float(measured[i - 1]), 2)], "y": [round(MILLI * float(measured[j - 1]), 2)]}
        seen = go.Scatter(**point, mode="markers", marker={"color": ORANGE, "size": 8, "symbol": "circle-open"}, name="depth camera")
        cross = go.Scatter(
            x=[0], y=[0], mode="markers", marker={"color": VERMILLION, "size": 10, "symbol": "cross-thin-open"}, name="truth"
        )
        for trace in (outline, seen, cross):
            figure.add_trace(trace, row=1, col=place)
        limits = [-reach[place - 1], reach[place - 1]]
        figure.update_xaxes(title_text=f"q<sub>{i}</sub> (mrad)", range=limits, row=1, col=place)
        figure.update_yaxes(title_text=f"q<sub>{j}</sub> (mrad)", range=limits, row=1, col=place)
    return _framed(figure, 230, showlegend=False)
