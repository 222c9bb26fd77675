"""The study as a stage: the same tables whatever the workers, a page whose words are those of its
table, and shares that more nodes do not change.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError
from pipeline.studies.factors import stage
from pipeline.studies.factors.shares import joined, share_table
from pipeline.studies.factors.words import answer, at_speed

ROOT = Path(__file__).parents[3]
OPTIONS = stage.Options(
    chunks=2,
    candidates=3000,
    nodes=16,
    tools=[0.15, 0.2],
    rests=[0.0],
    dividing_norm=16.0,
    dividing_travel=1.25,
    overspeed=1.1,
    alike=2.0,
)


@pytest.fixture(scope="module")
def shares(arm, stated):
    """The table ``factors`` of 6000 random paths by so many nodes."""

    def table(nodes: int):
        options = stage.Options(**vars(OPTIONS) | {"nodes": nodes})
        parts = [stage.spreads_of_chunk(i, *arm, stated, options, 1) for i in range(2)]
        names = stage.reading_columns(3, 3)
        return share_table(joined(parts), names, stated, 2.0, [0.0], 1.1, {})

    return table


def test_the_readings_that_are_too_wide_or_too_narrow_are_so_on_every_path(shares):
    rows = at_speed(shares(16), "matched")
    assert rows["paths"].min() > 50
    orders = rows.index.get_level_values("rows")
    names = rows.index.get_level_values("factorisation")
    wide = rows[names.isin(["pivoted_lu", "qr"]) | ((names == "lu") & orders.str.startswith("φ"))]
    assert len(wide) == 12 + 7
    assert wide["alike"].max() == 0 and wide["ratio_least"].min() > 2.3
    assert rows.loc["qr_transposed", "ratio_greatest"].item() < 0.5
    # the control: LU without pivoting in the natural order is alike on some
    assert rows.loc[("lu", "x z φ", "1-2-3"), "but_wider"] > 0.02
    text = answer(rows)
    assert "none of these fits" in text and f"{wide['ratio_least'].min():.3g} times" in text
    # and an answer follows its table
    other = rows.assign(alike=0.1)
    assert "none of these fits" not in answer(other)


def test_three_times_the_nodes_change_no_share_by_more_than_half_its_interval(shares):
    some, many = (at_speed(shares(nodes), "limit") for nodes in (16, 48))
    for name in ("but_wider", "but_size", "all"):
        half = (some[f"{name}_high"] - some[f"{name}_low"]) / 2
        assert np.all(np.abs(some[name] - many[name]) < half)


def test_subsets_count_every_path_once_a_kind(arm, stated):
    spreads = joined([stage.spreads_of_chunk(i, *arm, stated, OPTIONS, 1) for i in range(2)])
    masks = list(stage.subsets(spreads, OPTIONS).values())
    assert len(masks) == 6
    for pair in (masks[:2], masks[2:4], masks[4:]):
        assert np.all(pair[0] ^ pair[1]) and 0 < np.mean(pair[0]) < 1


@pytest.mark.slow
def test_the_stage_writes_its_page_and_does_not_depend_on_the_workers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("pipeline", "dvc.yaml", "data/raw", "reports/claims.yaml"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).symlink_to(ROOT / name)
    params = (ROOT / "params.yaml").read_text().replace("scale: paper", "scale: smoke")
    Path("params.yaml").write_text(params.replace("compute: local", "compute: serial"))
    config.write_config(Path("params.yaml"))
    stage.run()
    first = {file.name: file.read_bytes() for file in stage.OUT.iterdir()}
    rows = contracts.read("factors", stage.OUT, stage.HERE / "tables.yaml")
    page = Path("reports/studies/factors.md").read_text()
    assert answer(at_speed(rows, "matched")) in page
    assert "(factors/figures/factors.png)" in page and "nothing in its text" in page.lower()
    settings = config.COMPOSED.read_text()
    config.COMPOSED.write_text(settings.replace("workers: 1", "workers: 2"))
    stage.run()
    assert {file.name: file.read_bytes() for file in stage.OUT.iterdir()} == first


@pytest.mark.parametrize(("key", "value"), [("rests", [1.0]), ("chunks", 1)])
def test_options_that_mean_nothing_are_refused(key, value):
    with pytest.raises(ConfigError):
        stage.Options(**vars(OPTIONS) | {key: value})
