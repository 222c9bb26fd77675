"""Figures are found by their places: all are drawn or named with the reason why not, captions hold
numbers of other stages, and the bytes are the same every time.
"""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest

from pipeline.core import contracts
from pipeline.core.contracts import PAPER
from pipeline.core.errors import ContractError
from pipeline.core.options.analysis import Compute
from pipeline.figures.drawing import draw_all, figures_in

OUT = Path("reports/figures")
MOTION = Path("reports/metrics/motion.json")
METRICS = {
    "motion": {"additive_greatest_mean_error_rad": 0.01, "recorded_std_arm_1_rms_rad": 0.02},
    "filter": {"additive_arm_1_rms_error_rad": 0.03},
    "wrench": {"study_m3_mean_error": 0.04, "C1_measured_fx": 3.0},
}
DEPTH = {"articulation", "kinect_noise", "filter_closed_loop", "filter_errors"}
FIGURES = {name.rpartition(".")[2]: import_module(name) for name in figures_in("pipeline.figures")}

STUDY = '''"""A line of a study. Its numbers are those of one table."""

from pathlib import Path

from pipeline.figures.style import panels

TABLES = {"lines": "data/lines"}
DECLARATIONS = Path(__file__).with_name("tables.yaml")


def draw(lines, colour):
    figure, ((axes,),) = panels(2.0, 2.0)
    axes.plot(lines["x"], color=colour)
    return figure
'''


@pytest.fixture
def project(tmp_path, monkeypatch, tables):
    """A folder with the tables of all stages, and the numbers that captions state."""
    monkeypatch.chdir(tmp_path)
    for module in FIGURES.values():
        for table, folder in module.TABLES.items():
            Path(folder).mkdir(parents=True, exist_ok=True)
            contracts.write(tables[table], table, Path(folder))
    for name, metrics in METRICS.items():
        contracts.write_metrics(metrics, MOTION.with_name(f"{name}.json"))
    return tmp_path


@pytest.fixture
def draw(configurations):
    """Draws the figures of a package on one process."""
    options = {
        "models": ["additive", "wishart", "gaussian"],
        "joints": ["arm_1", "arm_2", "arm_3"],
        "mode": "one_step",
        "configurations": configurations,
        "colour": "black",
    }
    return lambda package="pipeline.figures", out=OUT: draw_all(
        package, out, options, Compute(workers=1), "figures"
    )


def remove(names: set[str]) -> None:
    """The tables of these figures, as a dataset without the instrument has none of them."""
    for name in names:
        for table, folder in FIGURES[name].TABLES.items():
            (Path(folder) / f"{table}.parquet").unlink(missing_ok=True)


def written(folder: Path = OUT) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


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
        "captions.json"
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
    assert names == drawn == {*json.loads((OUT / "captions.json").read_text())}


@pytest.mark.slow
def test_a_figure_that_cannot_be_drawn_leaves_the_folder_as_it_was(project, draw, capsys):
    remove({*FIGURES} - {"mean_error", "joint_std", "cable_robot"})
    draw()
    before = written()
    contracts.write_metrics({"something_else": 1.0}, MOTION)
    with pytest.raises(ContractError, match="no number named like"):
        draw()
    assert written() == before and not list(OUT.parent.glob(".*.partial"))
    MOTION.unlink()
    with pytest.raises(ContractError, match="no such metrics"):
        draw()
    assert written() == before


@pytest.mark.slow
def test_numbers_beside_a_figure_are_those_that_another_stage_wrote(project, draw):
    remove({*FIGURES} - {"mean_error", "joint_std", "cable_robot"})
    draw()
    caption = json.loads((OUT / "captions.json").read_text())["mean_error"]
    assert caption["numbers"] == {"additive_greatest_mean_error_rad": 0.01}
    assert caption["sources"] == ["data/score/deviation.parquet", "reports/metrics/motion.json"]
    assert caption["script"] == "pipeline/figures/mean_error.py"
    assert caption["title"] == "Error of the mean of each model's realisations"


def test_figures_of_another_package_are_found_and_read_tables_of_their_own(
    project, draw, monkeypatch
):
    folder = project / "lines_of_a_study"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "words.py").write_text("# a module without tables\n")
    (folder / "line.py").write_text(STUDY)
    (folder / "tables.yaml").write_text("lines:\n  x: real | a number\n")
    monkeypatch.syspath_prepend(project)
    declared = pd.DataFrame({"x": [0.0, 1.0]})
    Path("data/lines").mkdir()
    contracts.write(declared, "lines", Path("data/lines"), folder / "tables.yaml")
    draw("lines_of_a_study", Path("reports/lines"))
    assert {*written(Path("reports/lines"))} == {"line.svg", "line.png", "captions.json"}
    caption = json.loads(Path("reports/lines/captions.json").read_text())["line"]
    assert (caption["title"], caption["numbers"]) == ("A line of a study", {})


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_has_a_title_and_a_caption(name):
    title, _, text = " ".join(FIGURES[name].__doc__.split()).partition(". ")
    assert 10 < len(title) < 110 and len(text) > 100
