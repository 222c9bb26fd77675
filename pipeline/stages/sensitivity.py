"""sensitivity: which of the claims hang on what the paper leaves open, one decision at a time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from pipeline import config, contracts, rng, schema
from pipeline.audit.claims import decide, parse_claims
from pipeline.audit.sensitivity import sensitivity_table
from pipeline.compute.trials import run_trials
from pipeline.errors import DegenerateFilterError, ModelDomainError, SingularJacobianError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.motion.estimation import Recorded
from pipeline.motion.model import MotionModel
from pipeline.recordings.steps import training_steps
from pipeline.sensitivity.cameras import CLOCKS, Camera, camera_on
from pipeline.sensitivity.evidence import case_evidence
from pipeline.sensitivity.models import Outcome, Takes, outcome
from pipeline.sensitivity.variations import Case, FilterCase, ModelCase, paper_models, variations

INGEST, TRACK, NOISE = Path("data/ingest"), Path("data/track"), Path("data/noise")
ARTICULATE, OUT = Path("data/articulate"), Path("data/sensitivity")
CLAIMS, CONCLUSIONS = Path("reports/claims.yaml"), Path("pipeline/sensitivity/conclusions.yaml")
JOINTS = ["q1", "q2", "q3"]


def run() -> None:
    """Decide the claims in the base case, the run's own options, and in each of its variations."""
    settings = config.sections("sensitivity")
    options = FilterOptions(settings.filter.particles, settings.filter.scheme, settings.filter.threshold)
    takes, cameras = _takes(settings), _cameras(settings)
    base = Case(paper_models(settings.models), options, settings.simulation.mode)
    found = variations(base, float(takes.training.chain.lengths.mean()))
    if not cameras:
        print("sensitivity: no joint angles from a depth camera; what the paper leaves open of camera and filter falls away")
        found = [of for of in found if (of.case.filter, of.case.clock, of.case.batch) == (options, "aligned", 0)]

    asked = [(n, kind) for n, variation in enumerate(found) for kind in variation.case.models]
    cases = [found[n].case.of_model(kind) for n, kind in asked]
    trial = partial(_outcome, takes=takes, realizations=settings.simulation.realizations, seed=settings.seed)
    outcomes = dict(zip(asked, _each_once(trial, cases, cases, settings.compute, "sensitivity: models"), strict=True))

    seen = list(cameras["aligned"].takes) if cameras else []
    batches = [variation.case.takes_of(seen, settings.scale.sensitivity_takes) for variation in found]
    filtered = [(n, kind) for n, kind in asked if outcomes[n, kind].model is not None and batches[n]]
    runs = [(n, kind, take) for n, kind in filtered for take in batches[n]]
    cases = [found[n].case.of_filter(kind, take) for n, kind, take in runs]
    given = [
        (seen.index(case.take), case, outcomes[n, kind].model, cameras[case.clock].takes[case.take])
        for case, (n, kind, _) in zip(cases, runs, strict=True)
    ]
    trial = partial(_posterior, recorded=takes.training, rate=settings.dataset.motion.rate, start=_start(takes), seed=settings.seed)
    posteriors = dict(zip(runs, _each_once(trial, cases, given, settings.compute, "sensitivity: filters"), strict=True))

    claims = [claim for file in (CLAIMS, CONCLUSIONS) for claim in parse_claims(config.read_yaml(file).get("claims"))]
    verdicts = {}
    for n, (setting, value, case) in enumerate(found):
        of_models = {kind: outcomes[n, kind] for kind in case.models}
        of_filters = {kind: {take: posteriors[n, kind, take] for take in batches[n]} for kind in case.models if (n, kind) in filtered}
        evidence, refusals = case_evidence(case, takes, of_models, cameras.get(case.clock), of_filters)
        for refusal in refusals:
            print(f"sensitivity: {setting} {value}: {refusal}")
        # what the claims' rules say of the numbers, whatever recordings they may be decided by
        verdicts[setting, value] = decide(claims, evidence, "paper")
    with contracts.replacing(OUT) as folder:
        contracts.write(sensitivity_table(verdicts), "sensitivity", folder)


def _each_once(function: Callable, keys: list, arguments: list, compute: schema.Compute, label: str) -> list:
    """``function`` of every argument, worked out once for those of equal keys."""
    first = [keys.index(key) for key in keys]
    places = sorted(set(first))
    results = dict(zip(places, run_trials(function, [arguments[place] for place in places], compute=compute, label=label), strict=True))
    return [results[place] for place in first]


def _takes(settings: SimpleNamespace) -> Takes:
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion.rate)
    joints = contracts.read("joints", TRACK)
    _, poses = contracts.stacked(joints[joints.part == "training"], JOINTS)
    test = {take: np.array(rows[JOINTS], order="C") for take, rows in joints[joints.part == "test"].groupby("take")}
    return Takes(recorded, poses, test)


def _start(takes: Takes) -> Start:
    first = takes.poses[:, 0]
    return Start(first.mean(axis=0), np.cov(first.T))


def _cameras(settings: SimpleNamespace) -> dict[str, Camera]:
    """The depth camera on every clock, or none where the dataset has no depth camera."""
    if not contracts.exists("angles", ARTICULATE):
        return {}
    quality = contracts.read("quality", INGEST)
    offsets = quality[quality["quantity"] == "clock_offset"].set_index("take")["value"]
    angles, joints = contracts.read("angles", ARTICULATE), contracts.read("joints", TRACK)
    periods = {"frame": 1 / settings.dataset.depth.rate, "step": 1 / settings.dataset.motion.rate}
    return {clock: camera_on(clock, angles, joints, offsets, **periods, window=settings.articulation.noise_window) for clock in CLOCKS}


def _outcome(case: ModelCase, takes: Takes, realizations: int, seed: int) -> Outcome:
    # equal numbers in every variation, so that what differs is the variation's
    return outcome(case, takes, realizations, rng.stream(seed, f"sensitivity.{case.options.kind}", case.draw))


def _posterior(
    trial: tuple[int, FilterCase, MotionModel, Measurements], recorded: Recorded, rate: float, start: Start, seed: int
) -> Posterior | str:
    """The filter's posterior on one take, or why there is none."""
    number, case, model, seen = trial
    stream = rng.stream(seed, f"sensitivity.filter.{case.model.kind}", case.draw, number)
    try:
        return particle_filter(model, recorded.chain, recorded.v, 1 / rate, start, seen, case.options, stream)
    except (DegenerateFilterError, ModelDomainError, SingularJacobianError) as error:
        return str(error)
