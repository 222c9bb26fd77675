"""What the figures of the motion and of the filter show: which lines, of which numbers, on which
axes.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.figures import (
    articulation,
    filter_closed_loop,
    filter_errors,
    joint_realizations,
    joint_std,
    kinect_noise,
    mean_error,
)
from pipeline.figures.style import BLACK, BLUE, RECORDED, VERMILLION

MODELS = ["additive", "wishart", "gaussian"]
JOINTS = ["arm_1", "arm_2", "arm_3"]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def of_color(axes, color):
    return [line for line in axes.lines if line.get_color() == color]


def test_joint_realizations_shows_every_training_take_their_mean_and_the_noise_on_the_right(tables):
    figure = joint_realizations.draw(tables["joints"], tables["process_noise"])
    assert len(figure.axes) == 6
    training = tables["joints"].query("part == 'training'")
    for j, (left, right) in enumerate(zip(figure.axes[:3], figure.axes[3:], strict=True), start=1):
        takes = of_color(left, RECORDED["color"])
        assert len(takes) == 5
        np.testing.assert_array_equal(
            takes[1].get_ydata(), training[training["take"] == "training_002"][f"q:arm_{j}"]
        )
        (mean,) = (line for line in left.lines if line.get_linestyle() == "--")
        np.testing.assert_allclose(mean.get_ydata(), training.groupby("k")[f"q:arm_{j}"].mean())
        (noise,) = right.lines
        assert noise.get_linestyle() == "-."
        np.testing.assert_allclose(
            noise.get_ydata(), tables["process_noise"].groupby("k")[f"w:arm_{j}"].std()
        )
        assert left.get_ylabel() == f"arm {j} (rad)" and right.get_ylabel().endswith("(rad)")
    assert figure.axes[2].get_xlabel() == "time (s)"
    assert all(line.get_rasterized() for line in takes)


def test_joint_realizations_gives_all_joints_the_same_scale(tables):
    figure = joint_realizations.draw(tables["joints"], tables["process_noise"])
    spans = [np.ptp(axes.get_ylim()) for axes in figure.axes[:3]]
    np.testing.assert_allclose(spans, spans[0])
    assert len({axes.get_ylim() for axes in figure.axes[3:]}) == 1


@pytest.mark.parametrize("models", [MODELS, ["gaussian", "additive"]])
def test_mean_error_has_one_line_per_model_in_the_order_of_the_list(tables, models):
    figure = mean_error.draw(tables["deviation"], models)
    (axes,) = figure.axes
    assert len(axes.lines) == len(models) == len(legend(figure))
    for line, model in zip(axes.lines, models, strict=True):
        np.testing.assert_array_equal(
            line.get_ydata(), tables["deviation"].set_index("source").loc[model, "error"]
        )
    assert axes.get_ylabel().endswith("(rad)") and axes.get_xlabel() == "time (s)"


def test_joint_std_draws_the_recorded_line_solid_and_the_models_dashed_on_one_scale(tables):
    figure = joint_std.draw(tables["deviation"], MODELS, JOINTS, "one_step")
    assert legend(figure) == [
        "recorded",
        "additive Gaussian noise",
        "Wishart perturbation",
        "Gaussian noise matrix",
    ]
    for j, axes in enumerate(figure.axes, start=1):
        assert [line.get_linestyle() for line in axes.lines] == ["-", ":", "--", "-."]
        for line, source in zip(axes.lines, ["recorded", *MODELS], strict=True):
            np.testing.assert_array_equal(
                line.get_ydata(), tables["deviation"].set_index("source").loc[source, f"s:arm_{j}"]
            )
    assert len({axes.get_ylim() for axes in figure.axes}) == 1


def test_joint_std_says_which_standard_deviation_it_is(tables):
    labels = [
        joint_std.draw(tables["deviation"], MODELS, JOINTS, mode).axes[0].get_ylabel()
        for mode in ("one_step", "free_running")
    ]
    assert labels == ["std of the process noise (rad)", "std of the joint angle (rad)"]


def test_articulation_draws_the_segments_through_their_named_nodes_on_one_scale(tables):
    figure = articulation.draw(tables["cloud"], tables["skeleton"])
    for axes, view, letter in zip(figure.axes, ("initial", "extended"), "ab", strict=True):
        points, segments = axes.lines
        assert len(points.get_xdata()) == 50
        nodes = tables["skeleton"].set_index("view").loc[view]
        np.testing.assert_array_equal(segments.get_xydata(), nodes[["x", "z"]])
        assert [text.get_text() for text in axes.texts] == ["O1", "O2", "O3", "EE"]
        np.testing.assert_array_equal([text.xy for text in axes.texts], nodes[["x", "z"]])
        assert axes.get_title("left") == f"({letter})" and axes.get_aspect() == 1
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()


def test_articulation_labels_a_straight_arm_too(tables):
    straight = tables["skeleton"].assign(x=np.tile([0.0, 0.1, 0.2, 0.3], 2), z=0.2)
    figure = articulation.draw(tables["cloud"], straight)
    assert np.isfinite([text.xyann for axes in figure.axes for text in axes.texts]).all()


def test_kinect_noise_shows_the_estimate_from_all_takes_as_mean_and_standard_deviation(tables):
    figure = kinect_noise.draw(tables["kinect_noise"])
    rows = tables["kinect_noise"].query("take == 'none'")
    mean, std = figure.axes
    for j in (1, 2, 3):
        np.testing.assert_array_equal(mean.lines[j - 1].get_ydata(), rows[f"b:arm_{j}"])
        np.testing.assert_allclose(std.lines[j - 1].get_ydata() ** 2, rows[f"r:arm_{j}:arm_{j}"])
    assert [mean.get_title("left"), std.get_title("left")] == ["(a)", "(b)"]
    assert legend(figure) == ["arm 1", "arm 2", "arm 3"]


@pytest.mark.parametrize("models", [MODELS, ["wishart", "additive"], ["gaussian"]])
def test_filter_errors_has_a_row_per_model_with_one_take_its_bound_and_the_others(tables, models):
    figure = filter_errors.draw(tables["filter_error"], models, JOINTS)
    grid = np.reshape(figure.axes, (len(models), 3))
    for row, model in zip(grid, models, strict=True):
        take = tables["filter_error"].query("take == 'test_001'").set_index("model").loc[model]
        for j, axes in enumerate(row, start=1):
            (error,) = of_color(axes, BLUE)
            np.testing.assert_array_equal(error.get_ydata(), take[f"e:arm_{j}"])
            upper, lower = of_color(axes, VERMILLION)
            np.testing.assert_array_equal(upper.get_ydata(), take[f"s:arm_{j}"])
            np.testing.assert_array_equal(lower.get_ydata(), -take[f"s:arm_{j}"])
            without = tables["filter_error"].query("model == 'none'").groupby("t")[f"e:arm_{j}"]
            upper, lower = of_color(axes, BLACK)
            np.testing.assert_allclose(
                upper.get_ydata() ** 2, without.apply(lambda e: (e**2).mean())
            )
            np.testing.assert_array_equal(lower.get_ydata(), -upper.get_ydata())
            assert len(axes.lines) == 2 + 2 + 3  # two other takes
        assert row[0].get_ylabel().endswith("error (rad)")
    assert len({axes.get_ylim() for axes in figure.axes}) == 1
    assert legend(figure) == [
        "error of test_001",
        "±1σ bound of test_001",
        "rms error without a filter",
        "errors of the other takes",
    ]


def test_filter_errors_of_a_single_take_have_no_others_to_show(tables):
    alone = tables["filter_error"].query("take == 'test_001'")
    assert legend(filter_errors.draw(alone, MODELS, JOINTS)) == [
        "error of test_001",
        "±1σ bound of test_001",
        "rms error without a filter",
    ]


def test_filter_closed_loop_has_the_rms_error_of_each_loop_and_of_no_filter(tables):
    figure = filter_closed_loop.draw(tables["filter_error"], MODELS, JOINTS)
    grid = np.reshape(figure.axes, (len(MODELS), 3))
    by_model = tables["filter_error"].groupby(["model", "t"])
    for row, model in zip(grid, MODELS, strict=True):
        # of the models here one alone has a closed loop
        names = ["none", model] + (["wishart_closed"] if model == "wishart" else [])
        for j, axes in enumerate(row, start=1):
            rms = np.sqrt(by_model[f"e:arm_{j}"].apply(lambda e: (e**2).mean()))
            for line, name in zip(axes.lines, names, strict=True):
                np.testing.assert_allclose(line.get_ydata(), rms[name])
    assert legend(figure) == ["no filter", "open loop", "closed loop"]
