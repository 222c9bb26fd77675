"""Line styles that tell models apart, letters that can be read, and files that keep their bytes."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import rcParams
from PIL import Image

from pipeline.figures.style import RECORDED, model_lines, panels, save


def drawing(height=2.0, value=1.0):
    figure, ((axes,),) = panels(3.5, height)
    axes.plot([0, 1], [0, value], label="line")
    figure.legend(loc="outside upper center")
    return figure


def test_the_papers_models_have_the_dashes_of_its_figure():
    dashes = {
        model: line["linestyle"]
        for model, line in model_lines(["additive", "wishart", "gaussian"]).items()
    }
    assert dashes == {"additive": ":", "wishart": "--", "gaussian": "-."}
    assert RECORDED["linestyle"] == "-"


def test_models_of_other_names_differ_from_all_others_and_bear_their_names():
    named = ["wishart", "gaussian", "additive", "scaled", "scaled_full"]
    lines = model_lines(["wishart_qr", "new", *named, "other"])
    assert [*lines] == ["wishart_qr", "new", *named, "other"]
    assert [lines[name]["label"] for name in ("wishart_qr", "new", "other")] == [
        "wishart_qr",
        "new",
        "other",
    ]
    looks = [(line["color"], line["linestyle"]) for line in [*lines.values(), RECORDED]]
    assert len(set(looks)) == len(looks)


def test_no_letter_is_smaller_than_seven_points():
    names = (
        "font.size",
        "axes.titlesize",
        "axes.labelsize",
        "xtick.labelsize",
        "ytick.labelsize",
        "legend.fontsize",
    )
    assert min(rcParams[name] for name in names) >= 7


def test_the_same_figure_gives_the_same_bytes_and_another_gives_others(tmp_path):
    for name, value in (("one", 1.0), ("two", 1.0), ("other", 1.5)):
        save(drawing(value=value), tmp_path, name)
    for kind in ("svg", "png"):
        one, two, other = (
            (tmp_path / f"{name}.{kind}").read_bytes() for name in ("one", "two", "other")
        )
        assert one == two != other


def test_files_hold_no_date_and_no_version(tmp_path):
    save(drawing(), tmp_path, "figure")
    assert (
        "dc:date" not in (text := (tmp_path / "figure.svg").read_text())
        and "Matplotlib v" not in text
    )
    assert not {"Software", "Creation Time"} & set(Image.open(tmp_path / "figure.png").info)


@pytest.mark.parametrize("height", [1.5, 3.0])
def test_a_figure_has_the_size_it_was_asked_for(tmp_path, height):
    save(drawing(height), tmp_path, "figure")
    assert Image.open(tmp_path / "figure.png").size == (700, round(200 * height))


def test_no_label_touches_the_edge(tmp_path):
    figure, ((axes,),) = panels(3.5, 2.0)
    axes.set_yticks(range(3), ["linear, takes' memory", "gaussian, closed loop", "none"])
    save(figure, tmp_path, "figure")
    pixels = np.asarray(Image.open(tmp_path / "figure.png").convert("L"))
    assert (pixels[:, :5] == 255).all()
    # control: there is a label
    assert (pixels[:, :40] < 255).any()
