"""Surveys as they are asked for: the committed ones, and refusals that name the key and what there
is.
"""

from __future__ import annotations

from math import prod
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from pipeline.arm.model import load_arm
from pipeline.core.config import CONF
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.studies.survey import stage
from pipeline.studies.survey.options import read_survey
from pipeline.studies.survey.robots import trajectories

FOLDER = stage.HERE
SURVEYS = ("base", "large", "small", "tiny")


def ways(name: str) -> dict[str, TrajectoryOptions]:
    """The trajectories of a committed survey for the youBot, by name."""
    youbot = OmegaConf.load(CONF / "dataset/youbot.yaml")
    robot, own = youbot.robot, OmegaConf.to_container(youbot.laboratory.trajectory)
    chain = load_arm(robot.urdf, list(robot.joints), robot.tool, dict(robot.locked)).chain
    survey = read_survey(FOLDER / f"{name}.yaml")
    return trajectories(chain, TrajectoryOptions(**own), survey.trajectories)


@pytest.mark.parametrize("name", SURVEYS)
def test_every_committed_survey_asks_for_motions_that_the_youbot_can_do(name):
    assert all(way.duration > 0 for way in ways(name).values())


def test_the_small_survey_rests_a_tenth_and_six_tenths_of_the_time():
    small = ways("small")
    for name, share in (("a tenth at rest", 0.1), ("six tenths at rest", 0.6)):
        assert 4 * small[name].rest / small[name].duration == pytest.approx(share, abs=0.01)


def test_the_small_survey_has_as_many_conditions_as_one_machine_does_in_minutes():
    assert 40 <= len(read_survey(FOLDER / "small.yaml").conditions) <= 100


def test_the_large_survey_outgrows_one_machine_at_the_cost_per_condition_of_the_small_one():
    large, small = (read_survey(FOLDER / f"{name}.yaml") for name in ("large", "small"))
    assert (
        prod(map(len, (large.seeds, large.trajectories, large.particles, *large.factors.values())))
        > 1e6
    )
    sizes = ("training_takes", "test_takes", "realizations", "trajectories")
    assert all(getattr(large, name) == getattr(small, name) for name in sizes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"design": "latin"}, "no design 'latin'; there are one_at_a_time, factorial .*key design"),
        (
            {"factors": {"sway": [1.0]}},
            "no factor 'sway'; there are disturbances, sway_std, .*key factors.sway",
        ),
        ({"factors": {"clearance": [-1.0]}}, "none negative, found .-1.0.*key factors.clearance"),
        ({"factors": {"lasting": [0.0]}}, "all positive, found .0.0.*key factors.lasting"),
        ({"seeds": []}, "key seeds"),
        ({"particles": [0]}, "key particles"),
        ({"particles": [True]}, "key particles"),
        ({"test_takes": 2}, "at least 4, found 2 .*key test_takes"),
        (
            {"trajectories": {"own": {"speed": 2}}},
            "no key 'speed'; there are folded, extended, rest, pace .*of trajectories.own",
        ),
        ({"trajectories": {"own": {"pace": 0}}}, "positive number, found 0 .*key pace"),
        ({"trajectories": {"own": {"rest": -0.1}}}, "time in s, or null, found -0.1 .*key rest"),
        ({"trajectories": {"own": {"folded": [1, 2]}}}, "three joint angles"),
        ({"wrench": {"agents": [3, 5]}}, "list of lists"),
        ({"colour": "blue"}, "no key 'colour'; there are design, seeds"),
    ],
)
def test_a_bad_option_is_refused_by_its_key_and_with_the_choices(tmp_path, changes, said):
    values = OmegaConf.merge(OmegaConf.load(FOLDER / "tiny.yaml"), {})
    for key, value in changes.items():
        values[key] = OmegaConf.merge(values[key], value) if key == "wrench" else value
    file = tmp_path / "bad.yaml"
    OmegaConf.save(values, file)
    with pytest.raises(ConfigError, match=said) as refused:
        read_survey(file)
    assert refused.value.evidence["file"] == file


def test_a_missing_key_is_named(tmp_path):
    values = OmegaConf.load(FOLDER / "tiny.yaml")
    del values["seeds"]
    OmegaConf.save(values, tmp_path / "bad.yaml")
    with pytest.raises(ConfigError, match="'seeds' is missing"):
        read_survey(Path(tmp_path / "bad.yaml"))
