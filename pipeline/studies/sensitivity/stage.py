"""sensitivity: which of the claims hang on what the paper leaves open, one decision at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from omegaconf import MISSING

from pipeline.cases.camera import Camera
from pipeline.cases.case import Case, paper_models
from pipeline.cases.evaluate import Recordings, evaluate
from pipeline.cases.recorded import recorded_takes
from pipeline.cases.verdict import decided, read_claims
from pipeline.core import config, contracts
from pipeline.core.compute.trials import run_trials
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.studies import page
from pipeline.studies.sensitivity.clocks import CLOCKS, camera_on
from pipeline.studies.sensitivity.table import sensitivity_table
from pipeline.studies.sensitivity.variations import variations
from pipeline.studies.sensitivity.words import sections

HERE = Path(__file__).parent
TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
OUT, CONCLUSIONS = page.DATA / "sensitivity", HERE / "conclusions.yaml"


@dataclass
class Options:
    """Size of the study."""

    takes: int = MISSING  # test takes that the filter runs on in every variation


def run() -> None:
    """Decide the claims in the base case, the run's own options, and in each of its variations."""
    settings = config.sections("sensitivity", HERE / "dvc.yaml")
    recordings = _recordings(settings, config.study_options(HERE, Options))
    f = settings.filter
    options = FilterOptions(f.particles, f.scheme, f.threshold)
    base = Case(paper_models(settings.models), options, settings.simulation.mode)
    chain = recordings.takes.training.chain
    varied = variations(base, float(chain.lengths.mean()), chain.task)
    if not recordings.cameras:
        print(
            "sensitivity: no joint angles from a depth camera; what the paper leaves open of "
            "camera and filter falls away"
        )
        varied = [v for v in varied if _beside_camera(v.case, base)]
    run = partial(run_trials, compute=settings.compute, label="sensitivity: models and filters")
    evidence = evaluate([variation.case for variation in varied], recordings, run)
    claims, rows = read_claims(CONCLUSIONS), {}
    for (setting, value, _), (of_case, refusals) in zip(varied, evidence, strict=True):
        for refusal in refusals:
            print(f"sensitivity: {setting} {value}: {refusal}")
        rows[setting, value] = decided(claims, of_case, recordings.takes.arm)
    table = sensitivity_table(rows)
    with contracts.replacing(OUT) as folder:
        contracts.write(table, "sensitivity", folder, HERE / "tables.yaml")
    page.draw_figures("sensitivity", {}, settings.compute)
    statements = {claim.id: claim.statement for claim in claims}
    title = "Which claims hang on what the paper leaves open"
    page.write_page("sensitivity", title, sections(table, statements))


def _beside_camera(case: Case, base: Case) -> bool:
    """Whether nothing is decided otherwise of camera and filter."""
    return (case.filter, case.clock, case.batch) == (base.filter, base.clock, base.batch)


def _recordings(settings: SimpleNamespace, options: Options) -> Recordings:
    return Recordings(
        takes=recorded_takes(settings.dataset.robot, settings.dataset.motion),
        cameras=_cameras(settings),
        rate=settings.dataset.motion.rate,
        filtered=options.takes,
        realizations=settings.simulation.realizations,
        stream=(settings.seed, "sensitivity"),
    )


def _cameras(settings: SimpleNamespace) -> dict[str, Camera]:
    """The depth camera on every clock, or none where the dataset has no depth camera."""
    if not contracts.exists("angles", ARTICULATE):
        return {}
    quality = contracts.read("quality", TRACK)
    offsets = quality[quality["quantity"] == "clock_offset"].set_index("take")["value"]
    angles, joints = contracts.read("angles", ARTICULATE), contracts.read("joints", TRACK)
    periods = {"frame": 1 / settings.dataset.depth.rate, "step": 1 / settings.dataset.motion.rate}
    window = settings.articulation.noise_window
    return {
        clock: camera_on(clock, angles, joints, offsets, **periods, window=window)
        for clock in CLOCKS
    }
