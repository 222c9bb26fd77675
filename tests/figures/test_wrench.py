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
    (axes,) = wrench_error_histograms.draw(tables["wrench_errors"]).axes
    percent = 100 * tables["wrench_errors"].set_index("agents")["error"]
    edges = np.linspace(0, percent.max(), wrench_error_histograms.BINS + 1)
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
    *panels, colorbar = wrench_density.draw(tables["force_density"], configurations).axes
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
    (axes,) = cable_robot.draw().axes
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


def test_planes_have_the_measured_density_in_shades_and_the_model_in_lines_at_their_edges(tables):
    figure = wrench_planes.draw(tables["wrench_planes"])
    assert len(figure.axes) == 4
    for axes in figure.axes:
        shades, lines = axes.collections
        np.testing.assert_allclose(lines.levels, shades.levels[:-1])
        # the model's outermost line lies where its own density is that low, of a measured peak of 1
        places = np.vstack([path.vertices for path in lines.get_paths()[:1]])
        radius = 2 * np.sqrt(-2 * np.log(4 * wrench_planes.LEVELS[0]))
        np.testing.assert_allclose(np.hypot(*places.T), radius, atol=0.1)


def test_marginals_have_a_line_for_each_source_and_a_panel_for_each_row(tables):
    marginals = tables["wrench_marginals"]
    panels = wrench_marginals.draw(marginals).axes
    for axes, row in zip(panels, ("fx", "mz") * 2, strict=True):
        for line, source in zip(axes.lines, ("measured", "modelled"), strict=True):
            own = marginals[(marginals["source"] == source) & (marginals["row"] == row)]
            np.testing.assert_array_equal(line.get_ydata(), own["density"].to_numpy()[:21])
