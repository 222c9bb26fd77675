"""Overrides: single values below the options, each checked as the rest of the configuration is."""

from __future__ import annotations

import pytest

from pipeline.core.errors import ConfigError


def test_overrides_may_be_left_out(compose):
    assert compose(overrides=None) == compose()


@pytest.mark.parametrize("overrides", ["3", "text", "[1]"])
def test_overrides_that_are_no_keys_and_values_are_refused(compose, overrides):
    with pytest.raises(ConfigError, match="overrides must hold keys and values"):
        compose(overrides=overrides)


def test_a_model_that_is_not_chosen_cannot_be_overridden(compose):
    with pytest.raises(ConfigError, match="no model wishart is chosen; there are additive"):
        compose(
            models="[additive]",
            overrides="{models: {wishart: {kind: wishart, decomposition: qr, floor: 0.2}}}",
        )


def test_a_value_that_an_override_leaves_out_is_named(compose):
    with pytest.raises(
        ConfigError, match=r"no value for dataset\.force\.configurations\.C9\.direction, "
    ):
        compose(overrides="{dataset: {force: {configurations: {C9: {file: C9.csv}}}}}")


def test_an_override_changes_its_value_and_nothing_else(compose):
    laboratory = "{laboratory: {kinect: {scene: {tool_width: 0.07}}}}"
    overrides = f"{{dataset: {laboratory}, models: {{wishart: {{floor: 0.3}}}}}}"
    before, after = compose(), compose(overrides=overrides)
    assert after.dataset.laboratory.kinect.scene.tool_width == 0.07
    assert after.models.wishart.floor == 0.3
    after.dataset.laboratory.kinect.scene.tool_width = (
        before.dataset.laboratory.kinect.scene.tool_width
    )
    after.models.wishart.floor = before.models.wishart.floor
    assert after == before


def test_a_depth_camera_needs_the_rows_of_the_task_that_it_follows_the_tip_by(compose):
    with pytest.raises(ConfigError, match="by commanded x and z; keep both rows"):
        compose(overrides="{dataset: {robot: {task: [x, phi]}}}")
    assert compose(overrides="{dataset: {robot: {task: [z, x]}}}").dataset.depth is not None


def test_scientific_notation_without_a_point_is_a_number(compose):
    assert compose(overrides="{dataset: {mocap: {gate: 1e-3}}}").dataset.mocap.gate == 1e-3


def test_a_scale_reaches_the_options_that_refer_to_it(compose):
    composed = compose(overrides="{scale: {particles: 77, realizations: 33}}")
    assert (composed.filter.particles, composed.simulation.realizations) == (77, 33)
