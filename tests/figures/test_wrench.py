"""What the figures of the wrench show."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import QuadMesh
from matplotlib.patches import Arc

from pipeline.figures import (
    cable_robot,
    wrench_density,
    wrench_error_histograms,
    wrench_marginals,
    wrench_planes,
)


def test_histograms_count_every_system_and_state_mean_and_greatest_error(tables):
    figure = wrench_error_histograms.draw(tables["wrench_errors"])
    (axes,) = figure.axes
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    for m, patch, label in zip((3, 10), axes.patches, labels, strict=True):
        errors = 100 * tables["wrench_errors"].set_index("agents").loc[m, "error"]
        assert label == f"$m$ = {m}: mean {errors.mean():.1f}, greatest {errors.max():.1f} %"
        edges = np.linspace(
            0, 100 * tables["wrench_errors"]["error"].max(), wrench_error_histograms.BINS + 1
        )
        np.testing.assert_allclose(
            patch.get_xy()[1 : 2 * len(edges) - 1, 1][::2], np.histogram(errors, edges)[0]
        )
    assert axes.get_xlabel().endswith("(%)")


def test_densities_are_drawn_as_measured_and_modelled_on_one_range_and_one_colour_scale(
    tables, options
):
    figure = wrench_density.draw(tables["force_density"], options["configurations"])
    *panels, colorbar = figure.axes
    grid = np.reshape(panels, (2, 3))
    images = []
    for row, name in zip(grid, options["configurations"], strict=True):
        for axes, source in zip(row[1:], ("measured", "modelled"), strict=True):
            (image,) = (c for c in axes.collections if isinstance(c, QuadMesh))
            table = (
                tables["force_density"].set_index(["configuration", "source"]).loc[(name, source)]
            )
            np.testing.assert_array_equal(
                image.get_array(), table.pivot(index="fy", columns="fx", values="density")
            )
            images.append(image)
            assert axes.get_ylabel() == "$F_y$ (N)" and axes.get_aspect() == 1
    assert {image.get_clim() for image in images} == {(0, tables["force_density"]["density"].max())}
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in grid[:, 1:].ravel()}) == 1
    assert "N$^{-2}$" in colorbar.get_ylabel()


def test_the_robots_are_where_the_configuration_says_and_the_cross_is_their_resultant(
    tables, options
):
    figure = wrench_density.draw(tables["force_density"], options["configurations"])
    (drawing, density), first = figure.axes[:2], options["configurations"]["C1"]
    circles = np.array([line.get_xydata()[0] for line in drawing.lines if line.get_marker() == "o"])
    np.testing.assert_allclose(
        np.arctan2(circles[:, 1], circles[:, 0]), first.direction, atol=1e-12
    )
    # two cables pull against each other with 5 and 2 N, one across with 4
    (cross,) = density.lines
    np.testing.assert_allclose(cross.get_xydata()[0], [3.0, 4.0])
    arrows = [text.xy for text in drawing.texts if not text.get_text()]
    np.testing.assert_allclose(arrows[-1], [3.0, 4.0])
    np.testing.assert_allclose(np.linalg.norm(arrows[:-1], axis=1), first.tension)
    assert any(
        "5.00 N" in text.get_text() and "0.00 rad" in text.get_text() for text in drawing.texts
    )


def test_the_schematic_names_all_that_the_paper_names_in_solid_and_dashed():
    (axes,) = cable_robot.draw().axes
    labels = {text.get_text() for text in axes.texts}
    for i in (1, 2, 3):
        assert {f"$r_{i}$", rf"$\underline{{T}}_{i}$", rf"$\boldsymbol{{T}}_{i}$"} < labels
        assert {rf"$\underline{{\theta}}_{i}$", rf"$\boldsymbol{{\theta}}_{i}$"} < labels
    assert {"$x$", "$y$", "$u$", "$v$"} < labels
    assert [
        [line.get_linestyle() for line in axes.lines].count(dashes) for dashes in ("-", "--")
    ] == [3, 3]


def test_each_arc_of_the_schematic_spans_the_angle_of_its_cable():
    (axes,) = cable_robot.draw().axes
    arcs = [patch for patch in axes.patches if isinstance(patch, Arc)]
    cables = [line for line in axes.lines if line.get_linestyle() in ("-", "--")]
    for arc, cable in zip(arcs, cables, strict=True):
        start, tip = cable.get_xydata()
        np.testing.assert_array_equal(arc.get_center(), start)
        x, y = tip - start
        np.testing.assert_allclose(np.degrees(np.arctan2(y, x)) % 360, arc.theta2)


def test_planes_have_the_measured_density_in_shades_and_the_model_in_lines_at_their_edges(tables):
    figure = wrench_planes.draw(tables["wrench_planes"])
    assert len(figure.axes) == 4
    for axes in figure.axes:
        shades, lines = axes.collections
        np.testing.assert_allclose(lines.levels, shades.levels[:-1])
        assert lines.levels[0] == wrench_planes.LEVELS[0]  # the greatest measured density is 1
        # the model's outermost line lies where its own density is that low
        places = np.vstack([path.vertices for path in lines.get_paths()[:1]])
        radius = 2 * np.sqrt(-2 * np.log(4 * wrench_planes.LEVELS[0]))
        np.testing.assert_allclose(np.hypot(*places.T), radius, atol=0.1)
    labels = [axes.get_xlabel() for axes in figure.axes[:2]]
    assert labels == ["$F_x$ (N)", r"$M_x/\ell$ (N)"]


def test_marginals_have_a_line_for_each_source_and_a_panel_for_each_row(tables):
    marginals = tables["wrench_marginals"]
    figure = wrench_marginals.draw(marginals)
    assert len(figure.axes) == 4
    for axes, row in zip(figure.axes, ("fx", "mz") * 2, strict=True):
        for line, source in zip(axes.lines, ("measured", "modelled"), strict=True):
            own = marginals[(marginals["source"] == source) & (marginals["row"] == row)]
            np.testing.assert_array_equal(line.get_ydata(), own["density"].to_numpy()[:21])
