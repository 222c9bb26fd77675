"""depth: whether the error of the depth camera depends on the state where the tool's segment ends
at the commanded end-effector, and where its end is fitted; and what a filter makes of either.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
from omegaconf import MISSING

from pipeline.cases.camera import camera_of
from pipeline.cases.case import Case, paper_models
from pipeline.cases.evaluate import Recordings, evaluate
from pipeline.cases.evidence import pose_covariances
from pipeline.cases.fits import Takes
from pipeline.cases.recorded import recorded_takes
from pipeline.core import config, contracts
from pipeline.core.columns import values
from pipeline.core.compute.trials import run_trials
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.perception.articulation import ArticulationOptions
from pipeline.perception.articulation_end import ENDS
from pipeline.perception.depth_noise import errors_of
from pipeline.perception.depth_state import deviations, error_slopes
from pipeline.recordings.depth_angles import articulated, depth_takes
from pipeline.studies import page
from pipeline.studies.depth.compare import error_bins
from pipeline.studies.depth.words import NOTHING, TITLE, sections

HERE = Path(__file__).parent
TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
OUT = page.DATA / "depth"
MODEL = "additive"


@dataclass
class Options:
    """Size of the study."""

    takes: int = MISSING  # test takes that the filter runs on with either end


def run() -> None:
    """Fit the frames with either end, and hold errors and filters against each other."""
    settings = config.sections("depth", HERE / "dvc.yaml")
    count = config.study_options(HERE, Options).takes
    if contracts.exists("angles", ARTICULATE):
        tables = _tables(settings, count)
    else:
        print("depth: the dataset has no depth camera; nothing to do")
        tables = {}
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("depth", {}, settings.compute)
    page.write_page("depth", TITLE, sections(**tables) if tables else [NOTHING])


def _tables(settings: SimpleNamespace, count: int) -> dict[str, pd.DataFrame]:
    """The study's tables by name."""
    joints, step = contracts.read("joints", TRACK), 1 / settings.dataset.motion.rate
    takes = recorded_takes(settings.dataset.robot, settings.dataset.motion)
    angles = {end: _angles(end, settings) for end in ENDS}
    slopes, bins = {}, {}
    for end, table in angles.items():
        errors = errors_of(table, joints)
        about = deviations(errors, joints)
        rms = np.sqrt(np.mean(values(errors, "e") ** 2, axis=0))
        both = error_slopes(about, step, pose_covariances(takes)[0])
        slopes[end] = both.assign(error=np.tile(rms, len(both) // len(rms)))
        bins[end] = error_bins(about, step)
    tables = {"error_slopes": slopes, "error_bins": bins}
    tables["filters"] = _filters(angles, joints, takes, settings, count)
    return {
        name: pd.concat(by_end, names=["end"]).reset_index("end")
        for name, by_end in tables.items()
        if by_end
    }


def _angles(end: str, settings: SimpleNamespace) -> pd.DataFrame:
    """The table ``angles`` with the tool's segment ending at ``end``: the run's own, or a fit."""
    options = ArticulationOptions.chosen(settings.articulation)
    if options.end_point == end:
        return contracts.read("angles", ARTICULATE)
    options = replace(options, end_point=end)
    robot, compute = settings.dataset.robot, settings.compute
    return articulated(depth_takes(), robot, options, compute, f"depth: takes, end {end}")


def _filters(
    angles: dict[str, pd.DataFrame],
    joints: pd.DataFrame,
    takes: Takes,
    settings: SimpleNamespace,
    count: int,
) -> dict[str, pd.DataFrame]:
    """By end how the filter of the additive model fares on ``count`` takes, a row a joint.

    Args:
        angles: by end.
        joints: of the motion capture.
        takes: the same to fit to and to be held against.
        settings: of the run.
        count: how many takes are filtered.
    """
    model = paper_models(settings.models).get(MODEL)
    if model is None:
        print(f"depth: no {MODEL} model among the run's: no filter is compared")
        return {}
    window, f = settings.articulation.noise_window, settings.filter
    recordings = Recordings(
        takes=takes,
        cameras={end: camera_of(table, joints, window=window) for end, table in angles.items()},
        rate=settings.dataset.motion.rate,
        filtered=count,
        realizations=settings.simulation.realizations,
        stream=(settings.seed, "depth"),
    )
    options = FilterOptions(f.particles, f.scheme, f.threshold)
    cases = [Case({MODEL: model}, options, settings.simulation.mode, clock=end) for end in angles]
    run = partial(run_trials, compute=settings.compute, label="depth: filters")
    tables = {}
    for end, (evidence, refusals) in zip(angles, evaluate(cases, recordings, run), strict=True):
        for refusal in refusals:
            print(f"depth: end {end}: {refusal}")
        scores = evidence.get("metrics/filter", {})
        tables[end] = pd.DataFrame(
            [
                {"joint": joint}
                | {
                    name: scores[f"{MODEL}_{joint}_{key}"]
                    for name, key in (
                        ("error", "rms_error_rad"),
                        ("bound", "mean_bound_rad"),
                        ("coverage", "coverage_of_the_bound"),
                    )
                }
                for joint in (settings.dataset.robot.joints if scores else [])
            ],
            columns=["joint", "error", "bound", "coverage"],
        )
    return tables
