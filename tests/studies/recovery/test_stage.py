"""The recovery study as a stage: every estimator, the same data to all of a model, and nothing
where the motion never rests.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.core import config, contracts
from pipeline.studies.recovery import stage


@pytest.mark.slow
def test_every_estimator_is_given_data_and_the_tables_do_not_depend_on_the_workers(project):
    stage.run()
    first = {file.name: file.read_bytes() for file in stage.OUT.iterdir()}
    recovered = contracts.read("parameter_recovery", stage.OUT, stage.HERE / "tables.yaml")
    options = config.study_options(stage.HERE, stage.Options)
    assert set(recovered["estimator"]) == set(options.estimators)
    wishart = recovered[recovered["data"].str.startswith("wishart")]
    assert set(wishart["truth"]) == set(options.dispersions)
    assert len(wishart) == 2 * len(options.dispersions)
    assert np.all(recovered["datasets"] + recovered["without_an_estimate"] == options.datasets)
    choices = contracts.read("sigma_b_choices", stage.OUT, stage.HERE / "tables.yaml")
    assert choices.groupby(["source", "varied"])["truth"].nunique().to_dict() == {
        (source, varied): 0 if source == "recorded" else len(options.dispersions)
        for source in ("recorded", "drawn", "drawn without measurement noise")
        for varied in ("ratio", "floor")
    }
    # the choice of the stage fit is among both
    assert {1.0} < set(choices.loc[choices["varied"] == "ratio", "share"])
    floor = config.model_options(["wishart"])["wishart"].floor
    assert np.isclose(choices.loc[choices["varied"] == "floor", "floor"], floor).any()
    page = Path("reports/studies/recovery.md").read_text()
    assert "(recovery/figures/parameter_recovery.png)" in page
    settings = config.COMPOSED.read_text()
    config.COMPOSED.write_text(settings.replace("workers: 1", "workers: 2"))
    stage.run()
    assert {file.name: file.read_bytes() for file in stage.OUT.iterdir()} == first


def test_a_motion_that_never_rests_has_no_study(never_resting, capsys):
    stage.run()
    assert "never rests" in capsys.readouterr().out
    assert list(stage.OUT.iterdir()) == []
    assert "never rests" in Path("reports/studies/recovery.md").read_text()
