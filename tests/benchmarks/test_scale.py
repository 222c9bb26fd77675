"""What is run at scale: a fleet's fit by blocks is that of the whole, a share of the large grid
has equal bytes on a cluster, and the report says what was measured.
"""

from __future__ import annotations

import json
from dataclasses import replace

import fleet
import large_grid
import many_particles
import numpy as np
import pytest
import scale_section
from known_law import ROOT
from on_paper import Needs, beyond
from surveyed_project import write_surveyed_project

from pipeline.core import contracts
from pipeline.models.noise import mean_covariance, process_noise
from pipeline.models.wishart.dispersion import fit_wishart

TAKES = 20


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A fleet of a few takes in blocks of seven, fitted; the rows of every table it wrote."""
    folder, rows, write = tmp_path_factory.mktemp("fleet"), [], contracts.write
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fleet, "BLOCK", 7)
        patch.setattr(
            contracts,
            "write",
            lambda table, *rest: rows.append(table["take"].nunique()) or write(table, *rest),
        )
        fleet.record(folder, TAKES)
        fitted = fleet.fit(folder, TAKES)
        errors = fleet.filtered(folder, TAKES, 50, fitted)
        blocks = [fleet.place(folder, block) for block in fleet.blocks(TAKES)]
    return blocks, fitted, errors, rows


def together(blocks, name):
    """(takes, rows, 3) rad, the joint angles of all blocks."""
    tables = [contracts.read(name, folder) for folder in blocks]
    return np.concatenate([fleet.values(table, "q") for table in tables]).reshape(TAKES, -1, 3)


def test_the_fit_by_blocks_is_that_of_all_takes_at_once(recorded):
    blocks, fitted, _, _ = recorded
    q, v, chain = together(blocks, "joints"), fleet.commands(), fleet.youbot()
    noise = process_noise(chain, q, v)
    whole = fit_wishart(chain, q[:, :-1], v, noise, fleet.LU, fleet.FLOOR)
    assert fitted.sigma_b == pytest.approx(whole.sigma_b, rel=1e-9)
    np.testing.assert_allclose(fitted.noise_covariance, mean_covariance(noise), rtol=1e-6)
    np.testing.assert_allclose(fitted.start.mean, q[:, 0].mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(fitted.start.covariance, np.cov(q[:, 0].T), rtol=1e-6)
    # the control: the mean of the blocks' own estimates is another
    parts = [
        fit_wishart(chain, q[some, :-1], v, noise[some], fleet.LU, fleet.FLOOR).sigma_b
        for some in (slice(0, 7), slice(7, 14), slice(14, 20))
    ]
    assert np.mean(parts) != pytest.approx(whole.sigma_b, rel=1e-5)


def test_no_table_holds_more_than_a_block_of_takes_and_every_take_has_its_posterior(recorded):
    blocks, _, errors, rows = recorded
    assert rows == [7, 7, 7, 7, 6, 6, 7, 7, 6]
    posteriors = [contracts.read("posterior", folder) for folder in blocks]
    counts = [table.groupby("take").size() for table in posteriors]
    assert sum(map(len, counts)) == TAKES
    assert all((count == fleet.REST + fleet.MOVING + 1).all() for count in counts)
    assert 0 < errors["off_the_filter_rad"] < errors["off_the_mean_rad"]


def test_filters_of_few_and_of_more_particles_have_a_time_each():
    times = many_particles.seconds((100, 1000), rounds=1)
    assert set(times) == {100, 1000} and all(0 < each < 1 for each in times.values())


def test_what_ends_first_is_what_is_there_for_the_fewest():
    there = Needs(memory=10.0, disk=100.0, files=50.0, time=1000.0)
    fixed, each = Needs(memory=2.0), Needs(memory=0.1, disk=2.0, files=0.5, time=1.0)
    paper = beyond(1000, fixed, each, there)
    assert (paper.ends_first, paper.enough_for) == ("disk", 50.0)
    assert paper.needs == Needs(memory=102.0, disk=2000.0, files=500.0, time=1000.0)
    # the control: what does not grow never ends
    assert beyond(1000, fixed, replace(each, disk=0.0), there).ends_first == "memory"


@pytest.mark.slow
def test_the_share_has_equal_bytes_on_a_cluster_that_loses_a_worker(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_surveyed_project(tmp_path)
    measured = large_grid.run(tmp_path / "grid", 3, 1, workers=2)
    assert (measured["equal_bytes"], measured["workers_left"]) == (1, 1)
    assert measured["conditions"] == 3 and measured["seconds_a_condition"] > 0


FLEET = {
    "takes": 1000,
    "particles": 100,
    "steps": 12,
    "seconds": {"record": 1.0, "fit": 2.0, "filter": 30.0},
    "peak_bytes": 5e8,
    "kept_bytes": 14_000_000,
    "kept_files": 40,
    "sigma_b": 0.17,
    "true_sigma_b": 0.25,
    "off_the_filter_rad": 0.006,
    "off_the_mean_rad": 0.01,
}
CROWD = {
    "few": 10,
    "many": 1000,
    "steps": 40,
    "seconds_few": 5e-8,
    "seconds_many": 4e-8,
    "peak_bytes": 1e8,
    "bytes_of_a_particle": 118.2,
}
GRID = {
    "grid": 1_620,
    "conditions": 36,
    "workers": 3,
    "workers_left": 2,
    "seconds_by_the_clock": 20.0,
    "alone": 2,
    "equal_bytes": 2,
    "seconds_a_condition": 2.5,
}


def test_the_report_says_what_was_measured_and_what_ends_first(tmp_path):
    fleets = {"few": FLEET | {"takes": 100}, "many": FLEET}
    there = {"memory": 24e9, "disk": 80e9, "files": 1e7, "time": 2 * 86_400.0}
    measured = {"machine": "M", "there": there, "particles": CROWD}
    measured |= {"fleet": fleets, "grid": GRID}
    (tmp_path / "scale.json").write_text(json.dumps(measured))
    text = scale_section.section(tmp_path)
    for words in (
        "**1,000 takes of a simulated fleet**, 12 steps each",
        "record 1 ms, fit 2 ms, filter 30 ms of processor time, and 14.0 kB are kept",
        "takes 40 ns a particle and step, one of 10 50 ns, and holds 118 bytes",
        "`robustness`** has 1,620 conditions of about 2.5 s",
        "36 drawn by chance were run on a cluster of 3 workers",
        "Of the 2 that were run in one process too, 2 have equal bytes.",
        "24 GB of memory, 80 GB of disk and 1e+07 files free, and a day of every core, 2 days",
        "| takes of a fleet | 1e+08 | 500 MB | 1.4 TB | 4e+06 | 38 | a day of every core, at 5.2",
        "| particles of one filter | 1e+08 | 11.8 GB | – | – | 0.0019 | memory, at 2e+08 |",
    ):
        assert words in text


def test_the_committed_run_lost_a_worker_and_no_byte():
    measured = json.loads((ROOT / "reports/benchmarks/scale.json").read_text())
    grid, fleets = measured.get("grid", measured.get("survey")), measured["fleet"]
    assert grid["equal_bytes"] == grid["alone"] > 0
    assert grid["workers_left"] == grid["workers"] - 1
    # ten times the takes in a tenth more memory at most
    assert fleets["many"]["takes"] == 10 * fleets["few"]["takes"]
    assert fleets["many"]["peak_bytes"] < 1.1 * fleets["few"]["peak_bytes"]


def test_without_a_measurement_the_report_says_how_to_make_one(tmp_path):
    assert scale_section.section(tmp_path) == "Not measured yet: `make bench-scale`."


@pytest.mark.parametrize(("number", "text"), [(2e5, "0.2 MB"), (5.7e8, "570 MB"), (2e12, "2 TB")])
def test_bytes_have_the_unit_that_suits(number, text):
    assert scale_section.size(number) == text
