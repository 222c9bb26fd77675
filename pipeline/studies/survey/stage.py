"""survey: the claims over a grid of synthetic conditions, to see where they hold and where they
turn; a long run by hand, ``python -m pipeline survey NAME``, NAME an option file of this folder.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd

from pipeline.arm.model import arm_of
from pipeline.cases.case import paper_models
from pipeline.cases.verdict import read_claims
from pipeline.core import config, contracts
from pipeline.core.columns import matrices, values
from pipeline.core.errors import ConfigError
from pipeline.figures.style import save
from pipeline.recordings.steps import training_steps
from pipeline.studies import page
from pipeline.studies.survey.conditions import Factors
from pipeline.studies.survey.figure import draw
from pipeline.studies.survey.motion import MotionStudy
from pipeline.studies.survey.options import Survey, read_survey
from pipeline.studies.survey.points import Study, gather
from pipeline.studies.survey.robots import (
    Laboratory,
    NoiseLaw,
    perform,
    pose_noise,
    recorded,
    trajectories,
)
from pipeline.studies.survey.summary import Tally, against_the_pipeline, cost, verdict_counts
from pipeline.studies.survey.words import TITLE, sections
from pipeline.studies.survey.wrench import Configuration, ForceRig, WrenchStudy
from pipeline.studies.survey.written import write
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.run import read_run
from pipeline.wrench.bounds import Bounds

HERE = Path(__file__).parent
RECORD, SENSITIVITY = Path("data/raw/youbot/dvc.yaml"), HERE.parent / "sensitivity"
NOISE, OUT, REPORTS = Path("data/articulate"), page.DATA / "survey", page.REPORTS / "survey"
CONCLUSIONS = (SENSITIVITY / "conclusions.yaml", HERE / "conclusions.yaml")
LEFT_OUT = (
    "the faults and offsets of markers, the articulation of depth images, the estimate of clocks"
)
BESIDE = ["scaled_full"]  # scored beside the paper's models


def run(name: str) -> None:
    """Find or compute the point of every condition of the survey ``name``; write the table, the
    counts, the cost, the base condition's agreement, the figure and the page.
    """
    surveys = sorted(set(file.stem for file in HERE.glob("*.yaml")) - {"conclusions", "tables"})
    if name not in surveys:
        raise ConfigError(f"no survey {name!r}; there are {', '.join(surveys)}", key="NAME")
    options = read_survey(HERE / f"{name}.yaml")
    settings = config.sections("sensitivity", SENSITIVITY / "dvc.yaml")
    study = study_of(options, settings)
    gathered = gather(options.conditions, study, OUT / "points", settings.compute)
    print(
        f"survey: conditions: {gathered.reused} found, {gathered.computed} computed, "
        f"{gathered.unreadable} unreadable computed anew"
    )
    print(f"survey: no condition has {LEFT_OUT}")
    tally = Tally()
    with contracts.replacing(OUT / name) as folder:
        write(tally.passing(gathered.tables()), folder)
    with contracts.replacing(REPORTS / name) as folder:
        counts = verdict_counts(tally, options.design)
        counts.to_csv(folder / "verdicts.csv", index=False)
        _base_condition(tally, study.claims, folder)
        contracts.write_metrics(cost(tally.points, gathered.size), folder / "cost.json")
        save(draw(counts), folder, "survey")
    page.write_page("survey", TITLE, sections(REPORTS, LEFT_OUT))


def study_of(options: Survey, settings: SimpleNamespace) -> Study:
    """What the conditions of a survey have in common: as the last run of the paper had it, by its
    tables and ``settings``, those of the stage `sensitivity`.
    """
    return Study(_motion(options, settings), _wrench(options), read_claims(*CONCLUSIONS))


def _motion(options: Survey, settings: SimpleNamespace) -> MotionStudy:
    """What the stages `record` and `sensitivity` take from the configuration, and the instruments'
    noise from the tables of the run.
    """
    laboratory = config.sections("record", RECORD).dataset.laboratory
    if laboratory is None:
        raise ConfigError(
            "a survey needs the synthetic laboratory: choose a dataset with one and run `dvc "
            "repro`",
            key="dataset",
        )
    robot = settings.dataset.robot
    chain, joints = arm_of(robot).chain, tuple(robot.joints)
    noise = contracts.read("kinect_noise", NOISE)
    law = _law(noise[noise["take"] == "none"], laboratory["trajectory"].duration, joints)
    own = Laboratory(
        chain,
        joints,
        laboratory["dynamics"],
        {"": laboratory["trajectory"]},
        laboratory["clock"],
        np.zeros((len(joints),) * 2),
        law,
        settings.articulation.noise_window,
    )
    takes = perform(own, "", Factors(), settings.seed, "train", options.training_takes)
    robot_alone = recorded(own, "", np.stack([take.poses for take in takes])).measurement
    at_rest = training_steps(robot, settings.dataset.motion).measurement
    laboratory = replace(
        own,
        trajectories=trajectories(chain, laboratory["trajectory"], options.trajectories),
        pose_noise=pose_noise(at_rest, robot_alone),
    )
    return MotionStudy(
        laboratory,
        paper_models(settings.models) | config.model_options(BESIDE),
        settings.filter.scheme,
        settings.filter.threshold,
        settings.simulation.mode,
        options.training_takes,
        options.test_takes,
        options.realizations,
    )


def _law(noise: pd.DataFrame, duration: float, joints: tuple[str, ...]) -> NoiseLaw:
    """The depth camera's noise from rows of the table ``kinect_noise``; ``duration`` of the motion
    in s.
    """
    return NoiseLaw(
        noise["t"].to_numpy() / duration, values(noise, "b"), matrices(noise, "r", joints)
    )


def _wrench(options: Survey) -> WrenchStudy:
    """Bounds and configurations as the stage `wrench` has them, and the rig of the stage
    `record`.
    """
    settings = config.sections("wrench")
    laboratory = config.sections("record", RECORD).dataset.laboratory
    study, force = settings.wrench, settings.dataset.force
    bounds = Bounds(
        tuple(study.tension), tuple(study.direction), tuple(study.tension_std), tuple(study.kappa)
    )
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
    rig = ForceRig(laboratory["robots"], laboratory["transducer"], force.tare, size.force_seconds)
    return WrenchStudy(bounds, configurations, rig, size.systems, size.test_systems, size.repeats)


def _base_condition(tally: Tally, claims: tuple[Claim, ...], folder: Path) -> None:
    """Write and say how the base condition's verdicts agree with those of the run whose evidence is
    there.
    """
    name = config.sections("report").dataset.name
    run = read_run(Path("reports/datasets") / f"{name}.json")
    beside = against_the_pipeline(tally, claims, run.evidence, run.arm)
    beside.to_csv(folder / "base_condition.csv", index=False)
    differ = beside.loc[~beside["agrees"], "claim"].unique()
    print(
        f"survey: of {len(beside)} cases {beside['agrees'].sum()} come out in the base condition "
        "as in the whole pipeline"
    )
    if len(differ):
        print(f"survey: otherwise come out {', '.join(differ)}")
