"""The study as a stage: its page states what its tables hold, whatever the number of workers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.cases.readings import read_claims
from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError
from pipeline.studies.which_decomposition import stage
from pipeline.studies.which_decomposition.evidence import published
from pipeline.studies.which_decomposition.words import odds

HERE, ROOT = Path(stage.__file__).parent, Path(__file__).parents[2]
NAME = "which_decomposition"
DATA, PAGE = Path(f"data/studies/{NAME}"), Path(f"reports/studies/{NAME}.md")


@pytest.fixture
def claims(project):
    """The project, with the claims that hold the printed values."""
    Path("reports").mkdir(exist_ok=True)
    Path("reports/claims.yaml").symlink_to(ROOT / "reports/claims.yaml")


def read(name):
    """A table of the study."""
    return contracts.read(name, DATA, HERE / "tables.yaml")


def test_the_page_states_its_tables_and_the_bytes_do_not_depend_on_the_workers(claims):
    stage.run()
    first = {file.name: file.read_bytes() for file in DATA.iterdir()}
    text, evidence = PAGE.read_text(), read("evidence")
    assert len(text.split()) < 1200 and f"{NAME}/{NAME}.png" in text
    integrated = evidence[(evidence["tolerance"] == 0) & (evidence["size"] == "joints 1 and 2")]
    plain = integrated[integrated["reading"].isin(["lu_xzp", "lu_xpz", "lu_zxp", "lu_zpx"])]
    ends = plain["likelihood"].agg(["min", "max"])
    assert f"{odds(ends['min'])} to {odds(ends['max'])}" in text
    assert ("do not determine" in text) == (ends["min"] < 1 < ends["max"])
    # every reading has the recorded trace at its own level
    level = read("level")
    totals = (level["std"] ** 2).groupby(level["reading"]).sum(min_count=3)
    assert {"pivoted_lu", "qr", "qr_transposed"} <= set(totals.dropna().index)
    totals = totals.dropna()
    np.testing.assert_allclose(totals, totals["recorded"], rtol=1e-6)
    units = read("units").set_index(["reading", "unit", "turn"])["noise"]
    np.testing.assert_allclose(units["qr_transposed"], units["qr_transposed", "m", 0.0], rtol=1e-6)
    turned = units.loc[("qr", "m", 75.0)]
    np.testing.assert_allclose(turned, units["qr", "m", 0.0], rtol=1e-6)
    assert units["pivoted_lu", "mm", 0.0] > 10 * units["pivoted_lu", "m", 0.0]
    config.COMPOSED.write_text(config.COMPOSED.read_text().replace("workers: 1", "workers: 2"))
    stage.run()
    assert {file.name: file.read_bytes() for file in DATA.iterdir()} == first


def test_recordings_without_rest_have_no_level(claims, never_resting, capsys):
    stage.run()
    assert "never rests" in capsys.readouterr().out
    assert "measurement noise is unknown" in PAGE.read_text()
    assert not (DATA / "level.parquet").exists()


def test_the_values_and_every_entry_of_the_covariance_stand_in_the_claims():
    stated = published(read_claims())
    assert (stated.sigma_b, stated.alpha, stated.u) == (0.25, 0.1, 18)
    printed = [[0.0330, -0.0406, 0.0592], [-0.0406, 0.0547, -0.0839], [0.0592, -0.0839, 0.2457]]
    np.testing.assert_allclose(stated.covariance, np.array(printed) * 1e-3)
    np.testing.assert_allclose(stated.spread, [0.00574, 0.00740, 0.01567], atol=5e-6)


def test_a_value_that_is_not_stated_is_refused():
    claims = [claim for claim in read_claims() if claim.id != "alpha"]
    with pytest.raises(ConfigError, match="no claim"):
        published(claims)
