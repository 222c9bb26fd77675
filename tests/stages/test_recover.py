"""The recovery study as a stage: every estimator, the same data to all of a model, and nothing where the motion never rests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline import config, contracts
from pipeline.stages import recover


@pytest.mark.slow
def test_every_estimator_is_given_data_and_the_tables_do_not_depend_on_the_workers(project):
    recover.run()
    first = {file.name: file.read_bytes() for file in recover.OUT.iterdir()}
    found = contracts.read("parameter_recovery", recover.OUT)
    recovery = config.sections("recover").recovery
    assert set(found["estimator"]) == set(recovery.estimators)
    wishart = found[found["data"].str.startswith("wishart")]
    assert set(wishart["truth"]) == set(recovery.dispersions) and len(wishart) == 2 * len(recovery.dispersions)
    assert np.all(found["datasets"] + found["without_an_estimate"] == recovery.datasets)
    choices = contracts.read("sigma_b_choices", recover.OUT)
    assert choices.groupby(["source", "varied"])["truth"].nunique().to_dict() == {
        (source, varied): 0 if source == "recorded" else len(recovery.dispersions)
        for source in ("recorded", "drawn", "drawn without measurement noise")
        for varied in ("ratio", "floor")
    }
    # the choice of the stage fit is among both
    assert {1.0} < set(choices.loc[choices["varied"] == "ratio", "share"])
    assert np.isclose(choices.loc[choices["varied"] == "floor", "floor"], recovery.estimators["wishart"].floor).any()
    settings = config.COMPOSED.read_text()
    config.COMPOSED.write_text(settings.replace("workers: 1", "workers: 2"))
    recover.run()
    assert {file.name: file.read_bytes() for file in recover.OUT.iterdir()} == first


def test_a_motion_that_never_rests_has_no_study(project, capsys):
    trajectory = contracts.read("trajectory", Path("data/ingest"))
    contracts.write(trajectory.assign(vx=trajectory["vx"] + 1e-6), "trajectory", Path("data/ingest"))
    recover.run()
    assert "never rests" in capsys.readouterr().out
    assert list(recover.OUT.iterdir()) == []
