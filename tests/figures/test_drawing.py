"""Figures are found by their places: every one is drawn with units, a complete legend and all its
glyphs, or named with the reason why not; the bytes are the same every time.
"""

from __future__ import annotations

import json
import warnings
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rcParams
from PIL import Image

from pipeline.core import contracts
from pipeline.core.options.analysis import Compute
from pipeline.figures import drawing
from pipeline.figures.drawing import draw_all, figures_in
from pipeline.figures.style import RECORDED, joint_lines, model_lines, save

OUT = Path("data/figures")
CAPTIONS = OUT / "captions.json"
FIGURES = figures_in()
BARE = {"cable_robot"}  # a schematic without axes
TWICE = {"joint_realizations", "wrench_planes"}  # lines, pixels and contours; others in whole runs


def drawn(name: str, tables, options):
    """The figure of this name."""
    named = options | {table: tables[table] for table in FIGURES[name].tables}
    draw = FIGURES[name].draw
    return draw(**{key: named[key] for key in signature(draw).parameters})


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_has_units_a_complete_legend_all_glyphs_and_the_same_bytes(
    name, tables, options, tmp_path
):
    figure = drawn(name, tables, options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # matplotlib warns of glyphs that its font lacks
        save(figure, tmp_path, "one")
    if name in TWICE:
        save(drawn(name, tables, options), tmp_path, "two")
        for kind in ("svg", "png"):
            one, two = (tmp_path / f"{each}.{kind}" for each in ("one", "two"))
            assert one.read_bytes() == two.read_bytes()
    text = (tmp_path / "one.svg").read_text()
    assert "dc:date" not in text and "Matplotlib v" not in text
    image = Image.open(tmp_path / "one.png")
    assert image.size == tuple(np.round(200 * figure.get_size_inches()))
    assert (np.asarray(image.convert("L"))[:, :2] == 255).all()  # no label is cut at the edge
    shown = [axes for axes in figure.axes if axes.axison]
    assert bool(shown) == (name not in BARE)
    for axes in shown:
        # a strip's or a panel's quantity with its unit, but for counts
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert not label or any(mark in label for mark in ("(", "number of", "frames", "take:"))
    legends = [*figure.legends, *(axes.get_legend() for axes in shown if axes.get_legend())]
    entries = [text.get_text() for each in legends for text in each.get_texts()]
    assert len(entries) == len({*entries})
    labels = [line.get_label() for axes in shown for line in axes.lines]
    assert {label for label in labels if not label.startswith("_")} <= {*entries}
    assert 10 < len(FIGURES[name].title) < 110 and len(FIGURES[name].caption) > 100


@pytest.mark.slow
def test_figures_are_drawn_with_captions_or_left_out_by_name_and_all_or_none(
    tmp_path, monkeypatch, tables, options, capsys
):
    monkeypatch.chdir(tmp_path)
    kept = {"mean_error", "joint_std", "cable_robot"}  # one needs no table at all
    Path("data/score").mkdir(parents=True)
    contracts.write(tables["deviation"], "deviation", Path("data/score"))
    draw_all(OUT, options, Compute(workers=1))
    lines = {line for line in capsys.readouterr().out.splitlines() if "left out" in line}
    assert len(lines) == len(FIGURES) - len(kept)
    assert "figures: filter_errors left out: the dataset has no depth camera" in lines
    assert "figures: recording_quality left out: the dataset has no table takes" in lines
    assert {file.stem for file in OUT.iterdir()} == kept | {"captions"}
    captions = json.loads(CAPTIONS.read_text())
    assert {*captions} == kept
    assert captions["mean_error"]["sources"] == ["data/score/deviation.parquet"]
    assert captions["mean_error"]["script"] == "pipeline/figures/mean_error.py"
    before = {file: file.read_bytes() for file in OUT.iterdir()}
    broken = FIGURES["joint_std"]._replace(draw=lambda deviation: 1 / 0)
    monkeypatch.setattr(drawing, "figures_in", lambda: FIGURES | {"joint_std": broken})
    with pytest.raises(ZeroDivisionError):
        draw_all(OUT, options, Compute(workers=1))
    assert {file: file.read_bytes() for file in OUT.iterdir()} == before
    assert not list(OUT.parent.glob(".*.partial"))


def test_models_and_joints_differ_in_their_lines_and_the_papers_have_its_dashes():
    names = ["wishart", "gaussian", "additive", "scaled", "scaled_full"]
    lines = model_lines(["wishart_qr", "new", *names, "other"])
    dashes = [lines[name]["linestyle"] for name in ("additive", "wishart", "gaussian")]
    assert dashes == [":", "--", "-."] and RECORDED["linestyle"] == "-"
    assert [lines[name]["label"] for name in ("new", "other")] == ["new", "other"]
    joints = joint_lines([f"axis_{number}" for number in range(8)]).values()
    for looks in ([*lines.values(), RECORDED], joints):
        assert len({(line["color"], line["linestyle"]) for line in looks}) == len(looks)
    sizes = ("font.size", "axes.titlesize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize")
    assert min(rcParams[size] for size in sizes) >= 7
