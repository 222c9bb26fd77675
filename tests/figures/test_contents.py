"""Figures have units, a complete legend, all their glyphs and equal bytes, or are named with
the reason why not; its lines and marks are the numbers of its tables.
"""

import json
import warnings
from inspect import signature
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.cbook import is_math_text
from matplotlib.collections import QuadMesh
from matplotlib.patches import Arc
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from pipeline.core import contracts
from pipeline.core.columns import columns, pairs
from pipeline.core.options.analysis import Compute
from pipeline.figures import drawing, joint_error, motion, perception, wrench
from pipeline.figures.drawing import draw_all, figures_in
from pipeline.figures.mean_error import mean_error
from pipeline.figures.style import (
    BLACK,
    BLUE,
    RECORDED,
    VERMILLION,
    joint_lines,
    model_lines,
    save,
)
from pipeline.figures.takes import takes

MODELS = ["additive", "wishart", "gaussian"]
JOINTS = ["arm_1", "arm_2", "arm_3"]
OUT = Path("data/figures")
FIGURES = figures_in()
BARE = {"cable_robot"}  # a schematic without axes
TWICE = {"joint_realizations", "wrench_density"}  # lines, pixels; others in whole runs


RNG = np.random.default_rng(11)
SIMULATED = "simulated recordings"
HORIZONS = ("one sample", "0.1 s", "0.5 s")
STEPS = range(21)
SOURCES = ("measured", "modelled")


def rows_of(numbers: list[str], **keys) -> pd.DataFrame:
    """A row of random ``numbers`` for every combination of ``keys``, with the time of its step."""
    table = pd.MultiIndex.from_product(keys.values(), names=keys).to_frame(index=False)
    table = table.assign(**{name: RNG.random(len(table)) for name in numbers})
    return table.assign(t=table["k"] / 100) if "k" in keys else table


def paths(takes: list[str]) -> pd.DataFrame:
    """The table ``take_paths`` of an arm in a plane, whose last seven takes are left out."""
    numbers = [*columns("q", JOINTS), *columns("x", ("x", "z", "phi"))]
    rows = rows_of(numbers, take=takes, k=STEPS).drop(columns="k")
    left_out = rows["take"].isin(takes[-7:])
    reason = np.where(left_out, "longest_gap 41 beyond 20", "")
    return rows.assign(part="training", left_out=left_out, reason=reason)


TRAINING = [f"training_{n:03d}" for n in range(1, 6)]
TEST = [f"test_{n:03d}" for n in (1, 2, 3)]
VIEWS = ["initial", "extended"]


@pytest.fixture(scope="session")
def tables() -> dict[str, pd.DataFrame]:
    """One table of each kind that a figure shows."""
    return motion_tables() | parameter_tables() | depth_tables() | wrench_tables()


def motion_tables() -> dict[str, pd.DataFrame]:
    """Tables of takes, noise and held-out runs."""
    q, w, s = (columns(family, JOINTS) for family in "qws")
    joints = rows_of(q, take=TRAINING + TEST, k=STEPS).assign(residual=0.0)
    joints["part"] = joints["take"].str.partition("_")[0]
    noise = rows_of(w, take=TRAINING, k=STEPS[1:]).assign(part="training")
    std = rows_of(["error", "bias", *s], source=["recorded", *MODELS], k=STEPS)
    normal = np.arange(-3, 4.0)
    quantiles = rows_of(["noise"], model=[*motion.LAWS], joint=JOINTS, normal=normal)
    run = {"model": ["joint_error"], "joint": JOINTS, "horizon": HORIZONS[1:]}
    run |= {"t": np.linspace(0.0, 1.0, 11)}
    scored = {"model": ["joint_error", *joint_error.YARDSTICKS]}
    scored |= {"joint": JOINTS, "horizon": HORIZONS}
    scores = rows_of(["predicted_rad", "measured_rad"], **scored)
    return {
        "joints": joints,
        "process_noise": noise,
        "deviation": std,
        "noise_quantiles": quantiles,
        "held_out_run": rows_of(["error", "mean", "std"], **run),
        "joint_scores": scores.assign(samples="commanded", count=100),
        "takes": measured_takes(),
        "take_paths": paths(TRAINING + TEST),
    }


def measured_takes() -> pd.DataFrame:
    """The table ``takes`` of three takes, the second of which is left out, and four measures."""
    names = ["train_001", "train_002", "test_001"]
    takes = pd.DataFrame({"take": names, "left_out": [False, True, False]})
    takes["part"] = ["training", "training", "test"]
    measures = [
        ("residual_rms", "m", [2e-4, 2e-3, 3e-4], 1e-3),
        ("clock_drift", "s/s", [-1e-3, 2e-3, 0.0], 0.02),
        ("interpolated", "1", 0.0, np.nan),
        ("clock_drift_standard_error", "s/s", 1e-3, np.nan),
    ]
    rows = []
    for measure, unit, value, limit in measures:
        rows.append(takes.assign(measure=measure, value=value, unit=unit, limit=limit))
    return pd.concat(rows, ignore_index=True)


def parameter_tables() -> dict[str, pd.DataFrame]:
    """Tables of the ridge and of σ_B over the weight."""
    u = np.linspace(17.0, 20.0, 4)
    ridges = rows_of([], model=["gaussian"], level=[1.0], u=u)
    points = ["curve", "moments", "used"]
    weights = rows_of(["sigma_b"], source=["recorded", "drawn"], point=points)
    ratio = np.geomspace(1e-5, 0.1, 6)
    return {
        "ridges": ridges.assign(alpha=2 / u, excess=(u - 18.0) ** 2),
        "sigma_b_weights": weights.assign(model="wishart", ratio=ratio),
    }


def depth_tables() -> dict[str, pd.DataFrame]:
    """Tables of the depth camera and of the filters."""
    e, s, b = (columns(family, JOINTS) for family in "esb")
    models = ["none", *MODELS, "wishart_closed"]
    noise = [*b, *pairs("r", JOINTS), "t"]
    return {
        "filter_error": rows_of(e + s, model=models, take=TEST, k=STEPS),
        "kinect_noise": rows_of(noise, take=["test_001", "none"], frame=range(6)),
        "skeleton": rows_of(["x", "z"], view=VIEWS, node=range(4)),
        "cloud": rows_of(["x", "z"], view=VIEWS, point=range(50)),
    }


def wrench_tables() -> dict[str, pd.DataFrame]:
    """Tables of the wrench study, and of forces in the plane and in space."""
    plane = {"configuration": ["C1", "C2"], "source": SOURCES}
    space = {"configuration": ["T3", "T4"], "source": SOURCES}
    values = np.linspace(-4, 4, 21)
    return {
        "wrench_errors": rows_of(["error"], agents=[3, 10], system=range(40)),
        "force_density": rows_of(["density"], **plane, fx=range(9), fy=range(10)),
        "wrench_marginals": rows_of(
            ["density"],
            **space,
            row=["fx", "mz"],
            value=values,
        ),
    }


@pytest.fixture(scope="session")
def options() -> dict[str, object]:
    """The options of all figures, with two arrangements of robots, of three and of four cables."""
    first = SimpleNamespace(direction=[0.0, np.pi / 2, np.pi], tension=[5.0, 4.0, 2.0])
    second = SimpleNamespace(
        direction=[0.3, 1.9, 3.0, 5.0],
        tension=[5.0, 4.0, 2.0, 1.0],
    )
    configurations = {"configurations": {"C1": first, "C2": second}}
    named = {
        "models": MODELS,
        "joints": JOINTS,
        "mode": "one_step",
        "recordings": SIMULATED,
    }
    return named | configurations


def drawn(name: str, tables, options):
    """The figure of this name."""
    named = options | {table: tables[table] for table in FIGURES[name].tables}
    draw = FIGURES[name].draw
    return draw(**{key: named[key] for key in signature(draw).parameters})


def labels_of(legends) -> list[str]:
    """Texts of all entries of the legends."""
    entries = []
    for legend in legends:
        if legend is not None:
            entries += [text.get_text() for text in legend.get_texts()]
    return entries


def require_units(axes) -> None:
    """Require the unit of the quantity on each axis, but for counts."""
    for label in filter(None, (axes.get_xlabel(), axes.get_ylabel())):
        assert any(mark in label for mark in ("(", "number of", "frames", "take:"))


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_has_units_a_complete_legend_all_glyphs_and_the_same_bytes(
    name,
    tables,
    options,
    tmp_path,
):
    figure = drawn(name, tables, options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # matplotlib warns of glyphs that its font lacks
        save(figure, tmp_path, "one")
    if name in TWICE:
        save(drawn(name, tables, options), tmp_path, "two")
        for kind in ("svg", "png"):
            first = tmp_path / f"one.{kind}"
            second = tmp_path / f"two.{kind}"
            assert first.read_bytes() == second.read_bytes()
    assert "dc:date" not in (tmp_path / "one.svg").read_text()
    image = Image.open(tmp_path / "one.png").convert("L")
    assert (np.asarray(image)[:, :2] == 255).all()  # no label is cut

    shown = [axes for axes in figure.axes if axes.axison]
    assert bool(shown) == (name not in BARE)
    for axes in shown:
        require_units(axes)
    entries = labels_of([*figure.legends, *(axes.get_legend() for axes in shown)])
    assert len(entries) == len({*entries})
    for line in [line for axes in shown for line in axes.lines]:
        label = line.get_label()
        assert len(line.get_xdata())
        assert label.startswith("_") or label in entries
    assert 10 < len(FIGURES[name].title) < 110
    assert len(FIGURES[name].caption) > 100


@pytest.fixture
def score_folder(tmp_path, monkeypatch, tables) -> None:
    """A current directory that has the table ``deviation`` alone."""
    monkeypatch.chdir(tmp_path)
    folder = Path("data/score")
    folder.mkdir(parents=True)
    contracts.write(tables["deviation"], "deviation", folder)


DRAWABLE = {"mean_error", "joint_std", "cable_robot"}  # one needs no table at all


@pytest.mark.slow
@pytest.mark.usefixtures("score_folder")
def test_figures_are_drawn_with_captions_or_left_out_by_name_and_all_or_none(
    monkeypatch,
    options,
    capsys,
):
    draw_all(OUT, options, Compute(workers=1))

    printed = capsys.readouterr().out.splitlines()
    left_out = {line for line in printed if "left out" in line}
    assert len(left_out) == len(FIGURES) - len(DRAWABLE)
    reason = "filter_errors left out: the dataset has no depth camera"
    assert f"figures: {reason}" in left_out
    assert {file.stem for file in OUT.iterdir()} == DRAWABLE | {"captions"}
    captions = json.loads((OUT / "captions.json").read_text())
    assert {*captions} == DRAWABLE
    assert captions["mean_error"]["sources"] == ["data/score/deviation.parquet"]

    before = {file: file.read_bytes() for file in OUT.iterdir()}
    broken = FIGURES["joint_std"]._replace(draw=lambda deviation: 1 / 0)
    monkeypatch.setattr(drawing, "figures_in", lambda: FIGURES | {"joint_std": broken})
    with pytest.raises(ZeroDivisionError):
        draw_all(OUT, options, Compute(workers=1))
    assert {file: file.read_bytes() for file in OUT.iterdir()} == before
    assert not list(OUT.parent.glob(".*.partial"))


def test_a_joint_named_like_a_formula_is_plain_text():
    label = joint_lines(["arm_$x^2$"])["arm_$x^2$"]["label"]
    assert label == r"arm \$x^2\$"
    assert is_math_text("arm $x^2$") and not is_math_text(label)


def test_models_and_joints_differ_in_their_lines():
    models = model_lines(["wishart_qr", *MODELS, "joint_error", "other"]).values()
    joints = joint_lines([f"axis_{number}" for number in range(8)]).values()
    for looks in ([*models, RECORDED], joints):
        assert len({(line["color"], line["linestyle"]) for line in looks}) == len(looks)


def legend_of(figure) -> list[str]:
    return labels_of(figure.legends[:1])


def of_color(axes, color):
    return [line for line in axes.lines if line.get_color() == color]


def test_joint_realizations_shows_every_training_take_their_mean_and_the_noise_on_the_right(
    tables,
):
    training = tables["joints"].query("part == 'training'")
    of_second_take = training[training["take"] == "training_002"]
    mean = training.groupby("k").mean(numeric_only=True)
    std = tables["process_noise"].groupby("k").std(numeric_only=True)

    figure = motion.joint_realizations(tables["joints"], tables["process_noise"])

    for j, joint in enumerate(JOINTS):
        angles = figure.axes[j]
        noise = figure.axes[j + 3]
        lines = of_color(angles, RECORDED["color"])
        assert len(lines) == 5
        assert_array_equal(lines[1].get_ydata(), of_second_take[f"q:{joint}"])
        (of_mean,) = (line for line in angles.lines if line.get_linestyle() == "--")
        assert_allclose(of_mean.get_ydata(), mean[f"q:{joint}"])
        (of_noise,) = noise.lines
        assert of_noise.get_linestyle() == "-."
        assert_allclose(of_noise.get_ydata(), std[f"w:{joint}"])


def require_lines(axes, expected) -> None:
    """Require a line of each of the ``expected`` values, in their order."""
    for line, values in zip(axes.lines, expected, strict=True):
        assert_array_equal(line.get_ydata(), values)


def test_joint_std_and_mean_error_have_a_line_a_model_readable_beside_an_outlying_one(
    tables,
):
    deviation = tables["deviation"]
    by_source = deviation.set_index("source")

    figure = motion.joint_std(deviation, MODELS, JOINTS, "one_step", SIMULATED)
    entries = legend_of(figure)
    assert len(entries) == 4 and entries[0] == SIMULATED
    for axes, joint in zip(figure.axes, JOINTS, strict=True):
        assert [line.get_linestyle() for line in axes.lines] == ["-", ":", "--", "-."]
        sources = ["recorded", *MODELS]
        require_lines(axes, [by_source.loc[name, f"s:{joint}"] for name in sources])

    models = ["gaussian", "additive"]
    panels = mean_error(deviation, models).axes
    for axes, quantity in zip(panels, ("error", "bias"), strict=True):
        require_lines(axes, [by_source.loc[model, quantity] for model in models])

    wide = deviation.copy()
    stds = columns("s", JOINTS)
    outlying = wide["source"] == "wishart"
    wide.loc[outlying, stds] *= 50
    free = motion.joint_std(wide, MODELS, JOINTS, "free_running", SIMULATED)
    (top,) = {axes.get_ylim()[1] for axes in free.axes}
    assert top == pytest.approx(1.05 * wide.loc[~outlying, stds].max().max())


def test_articulation_draws_the_segments_through_their_named_nodes_on_one_scale(tables):
    by_view = tables["skeleton"].set_index("view")
    figure = perception.articulation(tables["cloud"], tables["skeleton"])
    for axes, view in zip(figure.axes, VIEWS, strict=True):
        nodes = by_view.loc[view, ["x", "z"]]
        points, segments = axes.lines
        assert len(points.get_xdata()) == 50 and axes.get_aspect() == 1
        assert_array_equal(segments.get_xydata(), nodes)
        assert [text.get_text() for text in axes.texts] == ["O1", "O2", "O3", "EE"]
        assert_array_equal([text.xy for text in axes.texts], nodes)


def test_kinect_noise_shows_the_estimate_from_all_takes_as_mean_and_standard_deviation(
    tables,
):
    rows = tables["kinect_noise"].query("take == 'none'")
    mean, std = perception.kinect_noise(tables["kinect_noise"]).axes
    for j, joint in enumerate(JOINTS):
        assert_array_equal(mean.lines[j].get_ydata(), rows[f"b:{joint}"])
        variance = rows[f"r:{joint}:{joint}"]
        assert_allclose(std.lines[j].get_ydata() ** 2, variance)


def test_filter_errors_has_a_row_per_model_with_one_take_its_bound_and_the_others(
    tables,
):
    errors = tables["filter_error"]
    of_one = errors.query("take == 'test_001'")
    squares = errors.query("model == 'none'").set_index("t")[columns("e", JOINTS)] ** 2
    rms = np.sqrt(squares.groupby("t").mean())

    figure = perception.filter_errors(errors, MODELS, JOINTS)

    rows = np.reshape(figure.axes, (len(MODELS), len(JOINTS)))
    for row, model in zip(rows, MODELS, strict=True):
        take = of_one[of_one["model"] == model]
        for axes, joint in zip(row, JOINTS, strict=True):
            (error,) = of_color(axes, BLUE)
            assert_array_equal(error.get_ydata(), take[f"e:{joint}"])
            bounds = {VERMILLION: take[f"s:{joint}"], BLACK: rms[f"e:{joint}"]}
            for color, bound in bounds.items():
                upper, lower = of_color(axes, color)
                assert_allclose(upper.get_ydata(), bound)
                assert_allclose(lower.get_ydata(), -bound)
            assert len(axes.lines) == 2 + 2 + 3  # two other takes
    assert len({axes.get_ylim() for axes in figure.axes}) == 1


def test_filter_errors_names_the_other_takes_where_there_are_some(tables):
    errors = tables["filter_error"]
    of_one = errors.query("take == 'test_001'")
    entries = legend_of(perception.filter_errors(errors, MODELS, JOINTS))
    alone = legend_of(perception.filter_errors(of_one, MODELS, JOINTS))
    assert entries == [*alone, "errors of the other takes"]


def test_histograms_count_every_system_and_state_mean_and_greatest_error(tables):
    (axes,) = wrench.wrench_error_histograms(tables["wrench_errors"]).axes
    percent = 100 * tables["wrench_errors"].set_index("agents")["error"]
    edges = np.linspace(0, percent.max(), wrench.BINS + 1)
    labels = labels_of([axes.get_legend()])
    for m, patch, label in zip((3, 10), axes.patches, labels, strict=True):
        errors = percent.loc[m]
        numbers = f"mean {errors.mean():.1f}, greatest {errors.max():.1f} %"
        assert label == f"$m$ = {m}: {numbers}"
        counts = patch.get_xy()[1 : 2 * len(edges) - 1, 1][::2]
        assert_allclose(counts, np.histogram(errors, edges)[0])


def test_densities_are_drawn_as_measured_and_modelled_on_one_range_and_one_colour_scale(
    tables,
    options,
):
    table = tables["force_density"]
    configurations = options["configurations"]
    by_place = table.set_index(["configuration", "source"])

    figure = wrench.wrench_density(table, configurations, SIMULATED)

    grid = np.reshape(figure.axes[:-1], (2, 3))[:, 1:]
    limits = set()
    scales = set()
    for row, name in zip(grid, configurations, strict=True):
        for axes, source in zip(row, SOURCES, strict=True):
            rows = by_place.loc[(name, source)]
            density = rows.pivot(index="fy", columns="fx", values="density")
            (image,) = (c for c in axes.collections if isinstance(c, QuadMesh))
            assert_array_equal(image.get_array(), density)
            scales.add(image.get_clim())
            limits.add((axes.get_xlim(), axes.get_ylim()))
    assert scales == {(0, table["density"].max())}
    assert len(limits) == 1


def test_the_schematic_names_all_that_the_paper_names_and_an_arc_spans_the_angle_of_its_cable():
    (axes,) = wrench.cable_robot().axes
    labels = {text.get_text() for text in axes.texts}
    symbols = (r"$r_{}$", r"$\underline{{T}}_{}$", r"$\boldsymbol{{T}}_{}$")
    symbols += (r"$\underline{{\theta}}_{}$", r"$\boldsymbol{{\theta}}_{}$")

    assert {symbol.format(i) for symbol in symbols for i in (1, 2, 3)} < labels
    assert {"$x$", "$y$", "$u$", "$v$"} < labels

    arcs = [patch for patch in axes.patches if isinstance(patch, Arc)]
    cables = [line for line in axes.lines if line.get_linestyle() in ("-", "--")]
    assert [line.get_linestyle() for line in cables] == ["-", "--"] * 3

    for arc, cable in zip(arcs, cables, strict=True):
        start, tip = cable.get_xydata()
        assert_array_equal(arc.get_center(), start)
        x, y = tip - start
        assert_allclose(np.degrees(np.arctan2(y, x)) % 360, arc.theta2)


def test_a_take_that_is_left_out_has_its_own_line_and_reason(tables):
    paths = tables["take_paths"]
    of_second_take = paths[paths["take"] == "training_002"]

    figure = takes(paths)

    tip, first_joint, *_ = figure.axes
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["tip", "arm 1", "arm 2", "arm 3"]
    assert (tip.get_xlabel(), tip.get_ylabel()) == ("x (m)", "z (m)")
    entries = legend_of(figure)
    assert entries[:2] == [
        "takes that stay",
        "left out: training_002 (longest_gap 41 beyond 20)",
    ]
    assert entries[-1] == "2 more, left out"
    assert len(entries) == 7
    assert_array_equal(first_joint.lines[1].get_ydata(), of_second_take["q:arm_1"])


def test_takes_of_an_arm_in_space_have_two_views_and_without_an_arm_only_angles(tables):
    rows = tables["take_paths"]
    in_space = rows.assign(**{"x:y": 0.1})
    labels = [axes.get_ylabel() for axes in takes(in_space).axes[:2]]
    assert labels == ["y (m)", "z (m)"]
    without_arm = rows.drop(columns=columns("x", ("x", "z", "phi")))
    assert len(takes(without_arm).axes) == len(JOINTS)
