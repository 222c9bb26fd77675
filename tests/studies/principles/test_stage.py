"""The study as a stage, and what the arm does in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_law import ROOT
from omegaconf import OmegaConf

from pipeline.core import config, contracts
from pipeline.laboratory.options import DynamicsOptions
from pipeline.laboratory.swing import desired_joints
from pipeline.studies.principles import stage
from pipeline.studies.principles.motion import correlations, driven, moved

TABLES = stage.HERE / "tables.yaml"


@pytest.fixture
def claimed(project) -> None:
    """The project with its claims."""
    Path("reports").mkdir(exist_ok=True)
    Path("reports/claims.yaml").symlink_to(ROOT / "reports/claims.yaml")


@pytest.mark.slow
def test_every_principle_has_its_number_on_the_page(claimed):
    stage.run()
    principles = contracts.read("principles", stage.OUT, TABLES)
    page = Path("reports/studies/principles.md").read_text()
    for row in principles.itertuples():
        assert row.quantity in page
    held = principles.dropna(subset="limit")
    assert f"## {held['kept'].sum()} of {len(held)} numbers are within their limits" in page
    assert Path("reports/studies/principles/figures/principles.png").is_file()
    lasting = contracts.read("principle_lasting", stage.OUT, TABLES)
    assert np.all(lasting.loc[lasting["lag"] == 0, "correlation"] == 1)
    torques = contracts.read("principle_torques", stage.OUT, TABLES)
    assert torques["greatest"].groupby(torques["joint"]).nunique().eq(1).all()


def test_a_recorded_dataset_has_no_laboratory_and_says_so(claimed, capsys):
    composed = OmegaConf.load(config.COMPOSED)
    composed.dataset.laboratory = None
    OmegaConf.save(composed, config.COMPOSED)
    stage.run()
    assert "there is no laboratory" in capsys.readouterr().out
    assert "The dataset is recorded" in Path("reports/studies/principles.md").read_text()


def test_the_arm_is_driven_at_full_speed_with_the_derivatives_of_its_path(chain, motion):
    still = DynamicsOptions(
        speed_error_std=0, encoder_ripple=0, start_std=0, sway_std=(0, 0, 0), clearance=0
    )
    arm = moved(chain, motion, replace(still, jitter_std=0), 2, np.random.default_rng(1))
    t, (q, speed, acceleration) = driven(motion, arm, 20)
    goal, commanded = desired_joints(t, motion)
    peak = np.abs(commanded).max()
    assert np.all(np.abs(commanded) > 0.98 * peak)
    np.testing.assert_allclose(q, np.stack([goal] * 2), atol=2e-3)
    np.testing.assert_allclose(speed, np.stack([commanded] * 2), atol=0.02 * peak)
    # at constant speed there is none but what the ramps' ends leave: 99 of 100 of the speed
    ramp = np.pi * peak / 2 / motion.ramp
    assert np.abs(acceleration).max() < 1.05 * ramp * np.sin(np.arccos(0.98))
    constant = np.abs(commanded).max(axis=1) > 0.99999 * peak
    assert np.abs(acceleration[:, constant]).max() < 0.02 * ramp
    assert np.abs(arm.deviation).max() < 1e-12
    # on the way out and on the way back
    assert np.any(t < motion.duration / 2) and np.any(t > motion.duration / 2)


def test_correlations_are_those_of_numpy():
    x = np.random.default_rng(1).standard_normal((3, 50))
    np.testing.assert_allclose(
        correlations(np.cov(x)), np.corrcoef(x)[np.triu_indices(3, 1)], rtol=1e-12
    )
