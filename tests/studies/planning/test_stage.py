"""An arm in a physics: what its models cannot plan is named, and what it performs is in tables."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError
from pipeline.studies.planning.motions import MINIMUM, RECORDED
from pipeline.studies.planning.stage import HERE, Options, tables_of
from pipeline.studies.survey.conditions import BASE, Factors

OPTIONS = Options(
    arms={"youbot": ["x", "z"]},
    models=["additive"],
    survey="tiny",
    takes=3,
    pace=0.64,
    margin=0.5,
    smoothness=0.1,
    conditioned=1000.0,
)
NAMED = {BASE: Factors(), "disturbances 2": Factors(disturbances=2.0)}


def test_an_arm_in_a_physics_has_its_tables(bench, tmp_path):
    bent = 0.05 * np.sin(np.linspace(0.0, np.pi, len(bench.recorded)))[:, None]
    known = {RECORDED: bench.recorded, MINIMUM: bench.recorded + bent}
    shared = ({"youbot": bench}, {"youbot": known}, NAMED, OPTIONS)
    models = config.model_options(OPTIONS.models)
    usual, twice = (tables_of(("youbot", name), *shared, models, 1) for name in NAMED)
    for name, rows in usual.items():
        contracts.write(rows, name, tmp_path, HERE / "tables.yaml")
    # the motions' courses are shown of the base condition alone
    assert {*usual} - {*twice} == {"planning_courses"}
    assert list(usual["planning_refused"]["model"]) == ["additive"]
    assert set(usual["planning_spreads"]["motion"]) == {RECORDED, MINIMUM}
    first, second = (tables["planning_spreads"]["sum"] for tables in (usual, twice))
    assert (second > 2 * first).all()
    again = tables_of(("youbot", BASE), *shared, models, 1)["planning_spreads"]
    assert again.equals(usual["planning_spreads"])


@pytest.mark.parametrize(("key", "value"), [("takes", 1), ("pace", 0.0)])
def test_options_out_of_range_are_refused(key, value):
    with pytest.raises(ConfigError, match=key):
        Options(**vars(OPTIONS) | {key: value})
