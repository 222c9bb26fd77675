"""The study of moments: errors fall as it says, the length weighs forces against moments, recorded
directions tell Ψ_S by their moments, and the page and the figure say what the tables do.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Wrench
from pipeline.studies.wrench_moments import stage
from pipeline.studies.wrench_moments.errors import ERRORS, Place, error_rows, slope_rows
from pipeline.studies.wrench_moments.figures import wrench_moments as figure
from pipeline.studies.wrench_moments.recorded import recorded_rows
from pipeline.studies.wrench_moments.words import (
    error_table,
    length_effect,
    length_table,
    psi_table,
    psi_verdict,
    shift_table,
    slopes,
)
from pipeline.wrench.bounds import draw_systems
from pipeline.wrench.matrix import matrix_model
from pipeline.wrench.parametric import wrench_covariance
from pipeline.wrench.study import averaged_sigma_s, variance_errors

STUDY = Wrench(
    agents=[3, 6, 12],
    kappa=[100.0, 800.0],
    tension_std=[0.5, 1.0],
    tension=[3.0, 5.0],
    direction=[np.pi / 4, np.pi],
    systems=200,
    test_systems=300,
    repeats=2,
)
OPTIONS = stage.Options(
    attachment=[-0.25, 0.25],
    elevation=[0.26, 1.3],
    agents=[3, 6, 12, 24],
    lengths=[0.01, 1.0, 100.0],
    recorded=stage.Recorded(agents=[6], systems=8, samples=400),
)
PLACES = stage.places(STUDY, OPTIONS)


@pytest.fixture(scope="module")
def errors():
    """The study's errors, small."""
    trials = [
        (number, length, repeat)
        for number in range(3)
        for length in (OPTIONS.lengths if number else [1.0])
        for repeat in range(STUDY.repeats if length == 1 else 1)
    ]
    return pd.concat([stage.error_table(trial, STUDY, 1, PLACES) for trial in trials])


@pytest.fixture(scope="module")
def recorded():
    """The study's recorded systems, few."""
    tables = [stage.recorded_table((n, 6), OPTIONS.recorded, 1, PLACES) for n in range(3)]
    return pd.concat(tables, ignore_index=True)


def test_an_error_is_the_papers_over_the_rows_of_its_part():
    place = replace(PLACES[2], agents=[5])
    row = error_rows(place, 1.0, 100, 50, np.random.default_rng(1)).set_index("part")
    assert place.length == pytest.approx(0.25)  # a cube's root mean square, half its side
    assert PLACES[1].length == pytest.approx(0.25 * np.sqrt(2 / 3))
    rng = np.random.default_rng(1).spawn(1)[0]
    drawn, fresh = (draw_systems(place.bounds, n, 5, rng).in_units_of(0.25) for n in (100, 50))
    modelled = matrix_model(fresh).covariance(averaged_sigma_s(drawn)["diagonal"].mean)
    due = wrench_covariance(fresh)
    for part, rows in (("forces", slice(3)), ("moments", slice(3, 6)), ("both", slice(6))):
        expected = variance_errors(modelled[:, rows, rows], due[:, rows, rows])
        assert row.loc[part, "variance"] == pytest.approx(expected.mean())
        assert row.loc[part, "variance_median"] == pytest.approx(np.median(expected))
    assert row["held"].nunique() == 1


def test_errors_fall_with_the_number_of_cables_and_without_off_diagonal_terms_hardly(errors):
    slope = slope_rows(errors).set_index(["place", "part", "error", "least"])["slope"]
    for place in ("point", "plane", "space"):
        assert -0.6 < slope[place, "forces", "variance", 3] < -0.35
    for least in (3, 6):
        assert slope["space", "forces", "covariance_full", least] < -0.35
        assert slope["space", "forces", "covariance_diagonal", least] > -0.25


def test_the_slope_of_a_power_law_is_its_power():
    agents, repeat = np.meshgrid([3, 6, 12, 24], range(3))
    law = pd.DataFrame({"agents": agents.ravel(), "repeat": repeat.ravel()})
    law = law.assign(place="space", part="forces", length=1.0)
    for number, error in enumerate(ERRORS):
        law[error] = (1 + law["repeat"]) * law["agents"] ** (-0.25 * number)
    rows = slope_rows(pd.concat([law, law.assign(length=2.0)]))
    expected = np.repeat(-0.25 * np.arange(len(ERRORS)), 2)
    np.testing.assert_allclose(rows["slope"], expected, atol=1e-12)
    np.testing.assert_allclose(rows["high"], expected, atol=1e-12)
    assert rows["least"].tolist() == [3, 6] * len(ERRORS)


def test_the_length_weighs_moments_against_forces_and_changes_neither_alone(errors):
    first = errors[(errors["repeat"] == 0) & (errors["place"] != "point")]
    table = first.set_index(["length", "part"])["variance"].groupby(level=[0, 1]).mean()
    for part in ("forces", "moments"):
        np.testing.assert_allclose(table[:, part], table[1.0, part], rtol=1e-9)
    assert table[0.01, "both"] == pytest.approx(table[0.01, "moments"], rel=1e-3)
    assert table[100.0, "both"] == pytest.approx(table[100.0, "forces"], rel=1e-3)
    assert abs(table[1.0, "both"] / table[1.0, "forces"] - 1) > 0.05
    assert "by up to" in length_effect(errors)


def test_recorded_directions_tell_psi_by_moments_and_the_likelihood_is_misled(recorded):
    table = recorded.set_index(["place", "part", "known"]).sort_index()
    for place, part in {(place, part) for place, part, _ in table.index}:
        error = table.loc[(place, part), "error"]
        assert error["moments"] < error["bounds"]
        assert error["likelihood"] > 2 * error["identity"]
    assert (table["agreement"] > 0.6).all()
    assert (table.loc[(slice(None), slice(None), "identity"), "difference"] == 0).all()


def test_alike_cables_leave_nothing_to_gain_by_psi():
    alike = replace(PLACES[2].bounds, concentration=(299.9, 300.1), attachment=None)
    table = recorded_rows(Place("space", alike, [6]), 6, 8, 400, np.random.default_rng(4))
    error = table.set_index("known")["error"]
    # what is estimated of Ψ_S = I is noise
    assert error["moments"] > 0.95 * error["identity"]


def test_tables_keep_their_contracts_and_the_page_says_what_they_do(errors, recorded, tmp_path):
    tables = {
        "wrench_moments": errors,
        "wrench_slopes": slope_rows(errors),
        "recorded_psi": recorded,
    }
    for name, table in tables.items():
        contracts.write(table, name, tmp_path, stage.HERE / "tables.yaml")
    lines = slopes(tables["wrench_slopes"]).splitlines()
    assert len(lines) == 2 + 2 * 7
    assert lines[2].startswith("| plane, one point, forces | m ≥ 3 | -0.")
    at_one = errors[errors["length"] == 1.0]
    mean = at_one[(at_one["place"] == "point") & (at_one["agents"] == 3)]["variance"].mean()
    assert f"| plane, one point, forces | 3 | {100 * mean:.3g} |" in error_table(at_one)
    assert len(length_table(errors).splitlines()) == 2 + 2 * 4
    assert psi_verdict(recorded).count("of 7 cases") == 2
    assert "by likelihood better in 0 of 7 cases" in psi_verdict(recorded)
    assert psi_table(recorded).count("plane, one point, forces | 6 |") == 1
    assert "(m = 24)" in shift_table(at_one)


def test_the_figure_draws_every_error_of_every_part(errors):
    plane, space = figure.draw(errors).axes
    table = errors[(errors["length"] == 1.0) & (errors["place"] == "space")]
    curves = [line for line in space.lines if line.get_marker() != "None"]
    drawn = iter(curves)
    for part in ("forces", "moments"):
        for error in figure.ERRORS:
            expected = 100 * table[table["part"] == part].groupby("agents")[error].mean()
            np.testing.assert_allclose(next(drawn).get_ydata(), expected)
    assert [len(curves), len(plane.lines), len(space.lines)] == [6, 5, 7]


@pytest.mark.parametrize("lengths", [[0.5, 2.0], [1.0, 0.5]])
def test_lengths_that_do_not_grow_through_one_are_refused(lengths):
    with pytest.raises(ConfigError, match="grow"):
        replace(OPTIONS, lengths=lengths)


def test_a_single_number_of_cables_is_refused():
    with pytest.raises(ConfigError, match="two numbers"):
        stage.places(replace(STUDY, agents=[3]), OPTIONS)


@pytest.mark.slow
def test_the_stage_writes_its_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("pipeline", "dvc.yaml", "data/raw"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).symlink_to(config.CONF.parents[1] / name)
    params = (config.CONF.parents[1] / "params.yaml").read_text()
    params = params.replace("scale: paper", "scale: smoke").replace(
        "compute: local", "compute: serial"
    )
    Path("params.yaml").write_text(params)
    config.write_config(Path("params.yaml"))
    stage.run()
    rows = contracts.read("recorded_psi", stage.OUT, stage.HERE / "tables.yaml")
    page = Path("reports/studies/wrench_moments.md").read_text()
    assert psi_table(rows) in page and "(wrench_moments/figures/wrench_moments.png)" in page
