"""Lines and marks of the figures are the numbers of their tables, on axes that belong to them."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.patches import Arc

from pipeline.figures import motion, perception, wrench
from pipeline.figures.mean_error import mean_error
from pipeline.figures.style import BLACK, BLUE, RECORDED, VERMILLION, joint_lines

MODELS = ["additive", "wishart", "gaussian"]
JOINTS = ["arm_1", "arm_2", "arm_3"]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def of_color(axes, color):
    return [line for line in axes.lines if line.get_color() == color]


def test_joint_realizations_shows_every_training_take_their_mean_and_the_noise_on_the_right(tables):
    figure = motion.joint_realizations(tables["joints"], tables["process_noise"])
    training = tables["joints"].query("part == 'training'")
    steps = tables["process_noise"].groupby("k")
    for j, (left, right) in enumerate(zip(figure.axes[:3], figure.axes[3:], strict=True), start=1):
        takes, own = of_color(left, RECORDED["color"]), training.set_index("take")[f"q:arm_{j}"]
        assert len(takes) == 5 and all(line.get_rasterized() for line in takes)
        np.testing.assert_array_equal(takes[1].get_ydata(), own["training_002"])
        (mean,) = (line for line in left.lines if line.get_linestyle() == "--")
        np.testing.assert_allclose(mean.get_ydata(), training.groupby("k")[f"q:arm_{j}"].mean())
        (noise,) = right.lines
        assert noise.get_linestyle() == "-."
        np.testing.assert_allclose(noise.get_ydata(), steps[f"w:arm_{j}"].std())
        assert left.get_ylabel() == f"arm {j} (rad)" and right.get_ylabel().endswith("(rad)")
    spans = [np.ptp(axes.get_ylim()) for axes in figure.axes[:3]]
    np.testing.assert_allclose(spans, spans[0])


def test_joint_std_and_mean_error_have_a_line_a_model_readable_beside_an_outlying_one(tables):
    deviation, by_source = tables["deviation"], tables["deviation"].set_index("source")
    figure = motion.joint_std(deviation, MODELS, JOINTS, "one_step")
    assert len(legend(figure)) == 4 and legend(figure)[0] == "recorded"
    for axes, joint in zip(figure.axes, JOINTS, strict=True):
        assert [line.get_linestyle() for line in axes.lines] == ["-", ":", "--", "-."]
        for line, source in zip(axes.lines, ["recorded", *MODELS], strict=True):
            np.testing.assert_array_equal(line.get_ydata(), by_source.loc[source, f"s:{joint}"])
    assert figure.axes[0].get_ylabel() == "std of the process noise (rad)"
    wide, own = deviation.copy(), [f"s:{joint}" for joint in JOINTS]
    outlying = deviation["source"] == "wishart"
    wide.loc[outlying, own] *= 50
    free = motion.joint_std(wide, MODELS, JOINTS, "free_running")
    assert free.axes[0].get_ylabel() == "std of the joint angle (rad)"
    (top,) = {axes.get_ylim()[1] for axes in free.axes}
    assert top == pytest.approx(1.05 * wide.loc[~outlying, own].max().max())
    (axes,) = mean_error(deviation, ["gaussian", "additive"]).axes
    for line, model in zip(axes.lines, ["gaussian", "additive"], strict=True):
        np.testing.assert_array_equal(line.get_ydata(), by_source.loc[model, "error"])


def test_articulation_draws_the_segments_through_their_named_nodes_on_one_scale(tables):
    figure = perception.articulation(tables["cloud"], tables["skeleton"])
    for axes, view in zip(figure.axes, ("initial", "extended"), strict=True):
        points, segments = axes.lines
        assert len(points.get_xdata()) == 50 and axes.get_aspect() == 1
        nodes = tables["skeleton"].set_index("view").loc[view, ["x", "z"]]
        np.testing.assert_array_equal(segments.get_xydata(), nodes)
        assert [text.get_text() for text in axes.texts] == ["O1", "O2", "O3", "EE"]
        np.testing.assert_array_equal([text.xy for text in axes.texts], nodes)
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()


def test_kinect_noise_shows_the_estimate_from_all_takes_as_mean_and_standard_deviation(tables):
    mean, std = perception.kinect_noise(tables["kinect_noise"]).axes
    rows = tables["kinect_noise"].query("take == 'none'")
    for j in (1, 2, 3):
        np.testing.assert_array_equal(mean.lines[j - 1].get_ydata(), rows[f"b:arm_{j}"])
        np.testing.assert_allclose(std.lines[j - 1].get_ydata() ** 2, rows[f"r:arm_{j}:arm_{j}"])


@pytest.mark.parametrize("models", [MODELS, ["gaussian"]])
def test_filter_errors_has_a_row_per_model_with_one_take_its_bound_and_the_others(tables, models):
    errors = tables["filter_error"]
    figure, alone = (
        perception.filter_errors(errors, models, JOINTS),
        errors.query("take == 'test_001'"),
    )
    mean = errors.query("model == 'none'").groupby("t")
    for row, model in zip(np.reshape(figure.axes, (len(models), 3)), models, strict=True):
        take = alone.set_index("model").loc[model]
        for axes, joint in zip(row, JOINTS, strict=True):
            rms = np.sqrt(mean[f"e:{joint}"].apply(lambda e: (e**2).mean()))
            (error,) = of_color(axes, BLUE)
            np.testing.assert_array_equal(error.get_ydata(), take[f"e:{joint}"])
            for color, bound in ((VERMILLION, take[f"s:{joint}"]), (BLACK, rms)):
                for line, sign in zip(of_color(axes, color), (1, -1), strict=True):
                    np.testing.assert_allclose(line.get_ydata(), sign * bound)
            assert len(axes.lines) == 2 + 2 + 3  # two other takes
        assert row[0].get_ylabel().endswith("error (rad)")
    assert len({axes.get_ylim() for axes in figure.axes}) == 1
    expected = ["error of test_001", "±1σ bound of test_001", "rms error of the training mean"]
    assert legend(figure) == [*expected, "errors of the other takes"]
    assert legend(perception.filter_errors(alone, MODELS, JOINTS)) == expected


ARMS = {"one": ["slide"], "seven": [f"lwr_a{number}" for number in range(7)]}


@pytest.mark.slow
@pytest.mark.parametrize("joints", ARMS.values(), ids=ARMS)
def test_every_joint_has_a_readable_panel_under_its_own_name(tables, joints):
    def of_arm(table, *families):
        keys = [name for name in tables[table] if ":" not in name]
        own = {f"{f}:{j}": tables[table][f"{f}:arm_1"] for f in families for j in joints}
        return tables[table][keys].assign(**own)

    names = [line["label"] for line in joint_lines(joints).values()]
    figures = (
        motion.joint_std(of_arm("deviation", "s"), MODELS, joints, "one_step"),
        perception.filter_errors(of_arm("filter_error", "e", "s"), MODELS, joints),
        motion.joint_realizations(of_arm("joints", "q"), of_arm("process_noise", "w")),
    )
    for figure in figures:
        shown = [axes.get_title() or axes.get_ylabel() for axes in figure.axes]
        assert [name.removesuffix(" (rad)") for name in shown[: len(joints)]] == names
        figure.draw_without_rendering()
        sizes = [axes.get_window_extent().size / figure.dpi for axes in figure.axes]
        assert np.all(np.array(sizes) >= (1.1, 0.7))  # in
        # every column of panels has the axis of time below it
        columns, below = (
            {round(axes.get_position().x0, 6) for axes in some}
            for some in (figure.axes, [a for a in figure.axes if a.get_xlabel() == "time (s)"])
        )
        assert columns == below


def test_recording_quality_has_takes_in_the_units_beside_them_limits_and_crosses(tables):
    strips = perception.recording_quality(tables["takes"]).axes
    measures = ("interpolated", "residual_rms", "clock_drift")
    names = [perception.STRIPS[measure][0] for measure in measures]
    assert [axes.get_ylabel() for axes in strips] == names
    kept, crossed = (strips[1].lines[i].get_xydata() for i in (0, 1))
    np.testing.assert_allclose(kept, [(1, 0.2), (3, 0.3)])
    np.testing.assert_allclose(crossed, [(2, 2.0)])
    assert [text.get_text() for text in strips[0].texts] == ["train_002"]
    dashed = [[line.get_ydata()[0] for line in axes.lines if line.is_dashed()] for axes in strips]
    assert dashed == [[], [1.0], [-20.0, 20.0]]
    for axes, limits in zip(strips, dashed, strict=True):
        low, high = axes.get_ylim()
        assert all(low < limit < high for limit in limits)


def test_histograms_count_every_system_and_state_mean_and_greatest_error(tables):
    (axes,) = wrench.wrench_error_histograms(tables["wrench_errors"]).axes
    percent = 100 * tables["wrench_errors"].set_index("agents")["error"]
    edges = np.linspace(0, percent.max(), wrench.BINS + 1)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    for m, patch, label in zip((3, 10), axes.patches, labels, strict=True):
        errors = percent.loc[m]
        assert label == f"$m$ = {m}: mean {errors.mean():.1f}, greatest {errors.max():.1f} %"
        counts = patch.get_xy()[1 : 2 * len(edges) - 1, 1][::2]
        np.testing.assert_allclose(counts, np.histogram(errors, edges)[0])


def test_densities_are_drawn_as_measured_and_modelled_on_one_range_and_one_colour_scale(
    tables, options
):
    configurations = options["configurations"]
    *panels, colorbar = wrench.wrench_density(tables["force_density"], configurations).axes
    grid, images = np.reshape(panels, (2, 3)), []
    by_place = tables["force_density"].set_index(["configuration", "source"])
    for row, (name, own) in zip(grid, configurations.items(), strict=True):
        for axes, source in zip(row[1:], ("measured", "modelled"), strict=True):
            (image,) = (c for c in axes.collections if isinstance(c, QuadMesh))
            density = by_place.loc[(name, source)].pivot(index="fy", columns="fx", values="density")
            np.testing.assert_array_equal(image.get_array(), density)
            images.append(image)
            assert axes.get_aspect() == 1
        # the robots are where the configuration says, and the cross is their resultant
        circles = [line.get_xydata()[0] for line in row[0].lines if line.get_marker() == "o"]
        angles = np.arctan2(*np.transpose(circles)[::-1]) % (2 * np.pi)
        np.testing.assert_allclose(angles, own.direction, atol=1e-12)
        arrows = np.array([text.xy for text in row[0].texts if not text.get_text()])
        np.testing.assert_allclose(np.linalg.norm(arrows[:-1], axis=1), own.tension)
        for place in (arrows[-1], row[1].lines[0].get_xydata()[0]):
            np.testing.assert_allclose(place, arrows[:-1].sum(axis=0), atol=1e-12)
        words = " ".join(text.get_text() for text in row[0].texts)
        assert "5.00 N" in words and f"{own.direction[0]:.2f} rad" in words
    assert {image.get_clim() for image in images} == {(0, tables["force_density"]["density"].max())}
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in grid[:, 1:].ravel()}) == 1
    assert "N$^{-2}$" in colorbar.get_ylabel()


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
        np.testing.assert_array_equal(arc.get_center(), start)
        x, y = tip - start
        np.testing.assert_allclose(np.degrees(np.arctan2(y, x)) % 360, arc.theta2)
