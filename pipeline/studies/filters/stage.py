"""filters: each filter between no filter and the best linear one that knows the laboratory's law;
and how that depends on how long a deviation of the arm lasts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import MISSING

from pipeline.core import config, contracts
from pipeline.core.columns import matrices, values
from pipeline.core.compute.trials import run_trials
from pipeline.core.filters import NONE
from pipeline.filtering.measurement import measurements
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.models.closed_loop import measured_poses
from pipeline.models.steps import Recorded
from pipeline.recordings.steps import training_steps
from pipeline.statistics.filters import no_filter
from pipeline.studies import page
from pipeline.studies.filters.camera import informed
from pipeline.studies.filters.deviations import Deviations, deviations
from pipeline.studies.filters.lasting import Sweep, lasted
from pipeline.studies.filters.linear import Filmed, exposed, filtered, linear_filters
from pipeline.studies.filters.scores import AT_REST, INFORMED, placed, scored, shown
from pipeline.studies.filters.words import TITLE, missing, sections
from pipeline.studies.survey.robots import Laboratory, NoiseLaw, pose_noise

HERE, OUT = Path(__file__).parent, page.DATA / "filters"
TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
AGAINST_NONE = Path("reports/tables/filter_against_none.csv")


@dataclass
class Options:
    """How much is simulated."""

    training: int = MISSING  # takes
    test: int = MISSING
    model: str = MISSING
    factors: list[float] = field(default_factory=list)


def run() -> None:
    """Filter the run's test takes and those of the arm alone, and write the page."""
    settings = config.sections("filters", HERE / "dvc.yaml")
    options, tables = config.study_options(HERE, Options), {}
    if settings.dataset.laboratory is not None and contracts.exists("angles", ARTICULATE):
        recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
        law = _law(recorded, settings.dataset.laboratory)
        response, rows = _run(recorded, law, settings)
        tables = {
            "filters_placed": rows,
            "filters_lasting": _sweep(recorded, law, options, settings),
        }
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("filters", {}, settings.compute)
    joints = settings.dataset.robot.joints
    text = sections(*tables.values(), joints, response) if tables else missing()
    page.write_page("filters", TITLE, text)


def _law(recorded: Recorded, laboratory: dict) -> Deviations:
    path = measured_poses(recorded).mean(axis=0)
    return deviations(recorded.chain, laboratory["trajectory"], laboratory["dynamics"], path)


def _run(recorded: Recorded, law: Deviations, settings) -> tuple[np.ndarray, pd.DataFrame]:
    """The response (n, n) of the camera, and the table ``filters_placed``: the filters that the run
    has scored, and beside them the linear ones.
    """
    joints, angles = contracts.read("joints", TRACK), contracts.read("angles", ARTICULATE)
    frames = measurements(angles, contracts.read("kinect_noise", ARTICULATE))
    takes = [take.take for take in frames]
    test = joints[joints["take"].isin(takes)]
    names, poses = contracts.stacked(test, "q")
    frames = [frames[takes.index(name)] for name in names]
    motion, names = settings.dataset.motion, recorded.joints
    training, pose = measured_poses(recorded), recorded.measurement / 2
    filmed = Filmed(training, poses, frames, pose, 1 / motion.rate, recorded.chain)
    filters = {NONE: no_filter(training, poses)}
    filters |= linear_filters(filmed, law, _lag(settings))
    known, response = informed(
        angles, test, training.mean(axis=0), settings.articulation.noise_window
    )
    by_take = {take.take: take for take in known}
    known = [by_take[take.take] for take in frames]
    filters[INFORMED] = exposed(filtered(filmed, known, law.covariance, response), law)
    own = scored(filters, names, np.append(~np.any(recorded.v, axis=1), True))
    rows = shown(pd.read_csv(AGAINST_NONE), names)
    own = own[(own["score"] != AT_REST) & ~own["filter"].isin(rows["filter"])]
    return response, placed(pd.concat([rows, own], ignore_index=True))


def _lag(settings) -> int:
    """A frame of the depth camera in steps of the motion."""
    return round(settings.dataset.motion.rate / settings.dataset.laboratory["clock"].rate)


def _sweep(recorded: Recorded, law: Deviations, options: Options, settings) -> pd.DataFrame:
    """The table ``filters_lasting``."""
    chosen = settings.filter
    sweep = Sweep(
        _laboratory(recorded, law, settings),
        options.model,
        config.model_options([options.model])[options.model],
        FilterOptions(chosen.particles, chosen.scheme, chosen.threshold),
        options.training,
        options.test,
        settings.seed,
    )
    trials: Sequence[float] = options.factors
    rows = run_trials(
        partial(lasted, sweep=sweep), trials, compute=settings.compute, label="filters: durations"
    )
    return pd.concat(rows, ignore_index=True)


def _laboratory(recorded: Recorded, law: Deviations, settings) -> Laboratory:
    """The arm of the run, with white noise of its instruments: of a pose what the run has at rest
    and the arm's law has not, of the depth camera what the run's has over the motion.
    """
    own, resting = settings.dataset.laboratory, ~np.any(recorded.v, axis=1)
    k = np.flatnonzero(resting)
    covariance = law.covariance
    across = covariance[k, :, k + 1]
    steps = covariance[k, :, k] + covariance[k + 1, :, k + 1] - across - across.swapaxes(-1, -2)
    noise = contracts.read("kinect_noise", ARTICULATE)
    noise, names = noise[noise["take"] == "none"], recorded.joints
    motion = own["trajectory"]
    camera = NoiseLaw(
        noise["t"].to_numpy() / motion.duration, values(noise, "b"), matrices(noise, "r", names)
    )
    return Laboratory(
        recorded.chain,
        names,
        own["dynamics"],
        {"": motion},
        own["clock"],
        pose_noise(recorded.measurement, steps.mean(axis=0)),
        camera,
        settings.articulation.noise_window,
    )
