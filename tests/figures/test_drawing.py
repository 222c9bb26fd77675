"""Figures are found by their places, drawn or named with the reason why not, in equal bytes."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

import pytest

from pipeline.core import contracts
from pipeline.core.contracts import PAPER
from pipeline.core.options.analysis import Compute
from pipeline.figures.drawing import draw_all, figures_in

OUT = Path("data/figures")
CAPTIONS = OUT / "captions.json"
DEPTH = {"articulation", "kinect_noise", "filter_closed_loop", "filter_errors"}
FIGURES = {name: import_module(f"pipeline.figures.{name}") for name in figures_in()}


@pytest.fixture
def project(tmp_path, monkeypatch, tables):
    """A folder with the tables of all stages."""
    monkeypatch.chdir(tmp_path)
    for module in FIGURES.values():
        for table, folder in module.TABLES.items():
            Path(folder).mkdir(parents=True, exist_ok=True)
            contracts.write(tables[table], table, Path(folder))
    return tmp_path


@pytest.fixture
def draw(configurations):
    """Draws the figures on one process."""
    options = {
        "models": ["additive", "wishart", "gaussian"],
        "joints": ["arm_1", "arm_2", "arm_3"],
        "mode": "one_step",
        "configurations": configurations,
    }
    return lambda: draw_all(OUT, options, Compute(workers=1))


def remove(names: set[str]) -> None:
    """The tables of these figures, as a dataset without the instrument has none of them."""
    for name in names:
        for table, folder in FIGURES[name].TABLES.items():
            (Path(folder) / f"{table}.parquet").unlink(missing_ok=True)


def written() -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in OUT.iterdir()}


def test_every_module_with_tables_is_a_figure_and_no_other():
    assert {"joint_std", "ridge", "cable_robot", "wrench_density"} < {*FIGURES}
    assert not {"style", "drawing"} & {*FIGURES}
    files = {file.stem for file in (PAPER.parents[1] / "figures").glob("[a-z]*.py")}
    assert {*FIGURES} == files - {"style", "drawing"}


@pytest.mark.slow
def test_every_figure_is_written_in_both_formats_and_the_same_every_time(project, draw):
    draw()
    first = written()
    assert {*first} == {f"{name}.{kind}" for name in FIGURES for kind in ("svg", "png")} | {
        CAPTIONS.name
    }
    draw()
    assert written() == first


@pytest.mark.slow
def test_figures_without_their_table_are_left_out_by_name_and_with_the_reason(
    project, draw, capsys
):
    drawn = {"wrench_error_histograms", "cable_robot"}  # of which one needs no table at all
    remove({*FIGURES} - drawn)
    draw()
    lines = {line for line in capsys.readouterr().out.splitlines() if "left out" in line}
    assert len(lines) == len(FIGURES) - len(drawn)
    for name in DEPTH:
        assert f"figures: {name} left out: the dataset has no depth camera" in lines
    lack = "force record of cables in a plane that meet in one point"
    assert f"figures: wrench_density left out: the dataset has no {lack}" in lines
    assert "figures: recording_quality left out: the dataset has no table takes" in lines
    names = {name.partition(".")[0] for name in written()} - {"captions"}
    assert names == drawn == {*json.loads(CAPTIONS.read_text())}


@pytest.mark.slow
def test_a_figure_that_cannot_be_drawn_leaves_figures_and_captions_as_they_were(
    project, draw, monkeypatch
):
    remove({*FIGURES} - {"mean_error", "joint_std", "cable_robot"})
    draw()
    before = written(), CAPTIONS.read_bytes()
    caption = json.loads(before[1])["mean_error"]
    assert caption["sources"] == ["data/score/deviation.parquet"]
    assert caption["script"] == "pipeline/figures/mean_error.py"
    assert caption["title"] == "Error of the mean of each model's realisations"
    monkeypatch.setattr(FIGURES["joint_std"], "draw", lambda deviation: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        draw()
    assert (written(), CAPTIONS.read_bytes()) == before
    assert not list(OUT.parent.glob(".*.partial"))


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_has_a_title_and_a_caption(name):
    title, _, text = " ".join(FIGURES[name].__doc__.split()).partition(". ")
    assert 10 < len(title) < 110 and len(text) > 100
