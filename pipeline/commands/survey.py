"""``python -m pipeline survey [NAME]``: the claims over a grid of synthetic conditions, an option file of pipeline/conf/survey."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd

from pipeline import config, contracts
from pipeline.arm.model import load_arm
from pipeline.audit.claims import Claim, parse_claims
from pipeline.audit.run import read_run
from pipeline.errors import ConfigError
from pipeline.figures.style import save
from pipeline.figures.survey import draw
from pipeline.recordings.steps import training_steps
from pipeline.sensitivity.variations import paper_models
from pipeline.survey.conditions import Factors
from pipeline.survey.laboratory import Laboratory, NoiseLaw, perform, pose_noise, recorded, trajectories
from pipeline.survey.motion import MotionStudy
from pipeline.survey.options import Survey, read_survey
from pipeline.survey.points import Study, gather
from pipeline.survey.summary import Tally, against_the_pipeline, cost, verdict_counts
from pipeline.survey.table import write
from pipeline.survey.wrench import Configuration, ForceRig, WrenchStudy
from pipeline.wrench.bounds import Bounds

RECORD = Path("data/raw/youbot/dvc.yaml")
NOISE, OUT, REPORTS = Path("data/noise"), Path("data/survey"), Path("reports/survey")
CLAIMS = (Path("reports/claims.yaml"), Path("pipeline/sensitivity/conclusions.yaml"), Path("pipeline/survey/conclusions.yaml"))
LEFT_OUT = "the faults and offsets of markers, the articulation of depth images, the estimate of clocks"
BESIDE = "scaled_full"  # scored beside the paper's models, where the run has it


def run(words: list[str]) -> None:
    """Find or compute every condition's point; write the table, the counts, the cost, the base condition's agreement and the figure."""
    parser = argparse.ArgumentParser(prog="python -m pipeline survey", description=__doc__.partition(": ")[2])
    parser.add_argument("name", nargs="?", default="small", metavar="NAME", help=f"one of {', '.join(config.options('survey'))}")
    name = parser.parse_args(words).name
    if name not in config.options("survey"):
        raise ConfigError(f"no survey {name!r}; there are {', '.join(config.options('survey'))}", key="NAME")
    options = read_survey(config.CONF / "survey" / f"{name}.yaml")
    claims = tuple(claim for file in CLAIMS for claim in parse_claims(config.read_yaml(file).get("claims")))
    decided_with = config.sections("sensitivity")
    study = Study(_motion(options, decided_with), _wrench(options), claims)
    gathered = gather(options.conditions, study, OUT / "points", decided_with.compute)
    print(f"survey: conditions: {gathered.found} found, {gathered.computed} computed, {gathered.unreadable} unreadable computed anew")
    print(f"survey: no condition has {LEFT_OUT}")
    tally = Tally()
    with contracts.replacing(OUT / name) as folder:
        write(tally.passing(gathered.tables()), folder)
    with contracts.replacing(REPORTS / name) as folder:
        counts = verdict_counts(tally, options.design)
        counts.to_csv(folder / "verdicts.csv", index=False)
        _base_condition(tally, claims, folder)
        contracts.write_metrics(cost(tally.points, gathered.size), folder / "cost.json")
        save(draw(counts), folder, "survey")


def _motion(options: Survey, settings: SimpleNamespace) -> MotionStudy:
    """What the stages `record` and `sensitivity` take from the configuration, and the instruments' noise from the tables of the run."""
    twin = config.sections("record", RECORD).dataset.twin
    if twin is None:
        raise ConfigError("a survey needs the synthetic laboratory: choose a dataset with one and run `dvc repro`", key="dataset")
    robot = settings.dataset.robot
    chain = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain
    seen = contracts.read("kinect_noise", NOISE)
    law = _law(seen[seen["take"] == "none"], twin["trajectory"].duration)
    own = Laboratory(
        chain, twin["dynamics"], {"": twin["trajectory"]}, twin["clock"], np.zeros((3, 3)), law, settings.articulation.noise_window
    )
    robot_alone = np.stack([take.poses for take in perform(own, "", Factors(), settings.seed, "train", options.training_takes)])
    at_rest = training_steps(robot, settings.dataset.motion.rate).measurement
    laboratory = replace(
        own,
        trajectories=trajectories(chain, twin["trajectory"], options.trajectories),
        pose_noise=pose_noise(at_rest, recorded(own, "", robot_alone).measurement),
    )
    beside = {name: model for name, model in settings.models.items() if name == BESIDE}
    return MotionStudy(
        laboratory, paper_models(settings.models) | beside, settings.filter.scheme, settings.filter.threshold, settings.simulation.mode,
        options.training_takes, options.test_takes, options.realizations,
    )  # fmt: skip


def _law(noise: pd.DataFrame, duration: float) -> NoiseLaw:
    """The depth camera's noise from rows of the table ``kinect_noise``; ``duration`` of the motion in s."""
    covariance = np.array([[noise[f"r{min(i, j)}{max(i, j)}"] for j in (1, 2, 3)] for i in (1, 2, 3)])
    return NoiseLaw(noise["t"].to_numpy() / duration, noise[["b1", "b2", "b3"]].to_numpy(), covariance.transpose(2, 0, 1))


def _wrench(options: Survey) -> WrenchStudy:
    """Bounds and configurations as the stage `wrench` has them, and the rig of the stage `record`."""
    settings, twin = config.sections("wrench"), config.sections("record", RECORD).dataset.twin
    of_study, force = settings.wrench, settings.dataset.force
    bounds = Bounds(tuple(of_study.tension), tuple(of_study.direction), tuple(of_study.tension_std), tuple(of_study.kappa))
    within = (tuple(force.tension_std_bounds), tuple(force.kappa_bounds))
    configurations = {
        name: Configuration(
            Bounds(tuple(force.tension_bounds), tuple(each.direction_bounds), *within),
            list(each.tension),
            list(each.direction),
            list(force.tension_std),
        )
        for name, each in force.configurations.items()
    }
    size = options.wrench
    rig = ForceRig(twin["robots"], twin["transducer"], force.tare, size.force_seconds)
    return WrenchStudy(bounds, configurations, rig, size.systems, size.test_systems, size.repeats)


def _base_condition(tally: Tally, claims: tuple[Claim, ...], folder: Path) -> None:
    """Write and say how the base condition's verdicts agree with those of the run whose evidence is there."""
    run_of = read_run(Path("reports/datasets") / f"{config.sections('report').dataset.name}.json")
    beside = against_the_pipeline(tally, claims, run_of.evidence)
    beside.to_csv(folder / "base_condition.csv", index=False)
    differ = beside.loc[~beside["agrees"], "claim"].unique()
    print(f"survey: of {len(beside)} cases {beside['agrees'].sum()} come out in the base condition as in the whole pipeline")
    if len(differ):
        print(f"survey: otherwise come out {', '.join(differ)}")
