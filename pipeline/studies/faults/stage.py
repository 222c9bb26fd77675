"""faults: what every kind of fault does to the recordings' results: repaired and counted, or
refused, and how far off the truth then.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import MISSING

from pipeline.arm.model import arm_of
from pipeline.core import config, contracts, rng
from pipeline.core.columns import columns
from pipeline.core.compute.trials import run_trials
from pipeline.perception.articulation import ArticulationOptions
from pipeline.studies import page
from pipeline.studies.faults.bench import Bench, suffer
from pipeline.studies.faults.fault import OUTCOMES, Fault
from pipeline.studies.faults.recordings import depth_bench, force_bench, marker_bench
from pipeline.studies.faults.registry import DEPTH, FAULTS, FORCE, MOTION_CAPTURE
from pipeline.studies.faults.words import sections

HERE = Path(__file__).parent
INGEST, TRACK, OUT = Path("data/ingest/motion"), Path("data/track"), page.DATA / "faults"


@dataclass
class Options:
    """Size of the study."""

    takes: int = MISSING  # test takes that every fault of the motion capture is inflicted on


def run() -> None:
    """Inflict every fault at each level of severity on a few test takes and one force record."""
    settings = config.sections("faults", HERE / "dvc.yaml")
    options = config.study_options(HERE, Options)
    joints = settings.dataset.robot.joints
    with contracts.replacing(OUT) as folder:
        if settings.dataset.laboratory is not None:
            table = _inflicted(settings, options)
            contracts.write(table, "faults", folder, HERE / "tables.yaml")
    page.draw_figures("faults", {"joints": joints}, settings.compute)
    if settings.dataset.laboratory is None:
        lacking = "The dataset has no synthetic laboratory, and so no truth to compare with."
        print(f"faults: {lacking}")
        page.write_page("faults", "Faults in the recordings", [lacking])
    else:
        page.write_page("faults", "Faults in the recordings", sections(table))


def _inflicted(settings, options: Options) -> pd.DataFrame:
    """The table ``faults``."""
    benches = _benches(settings, options.takes)
    trials = [
        (name, fault.name, level)
        for name, (instrument, _) in benches.items()
        for fault in FAULTS.values()
        if fault.instrument == instrument
        for level in range(len(fault.levels))
    ]
    inflict = partial(
        _trial, benches={name: bench for name, (_, bench) in benches.items()}, seed=settings.seed
    )
    rows = run_trials(inflict, trials, compute=settings.compute, label="faults: trials")
    return _summary(pd.DataFrame(rows))


def _benches(settings, count: int) -> dict[str, tuple[str, Bench]]:
    """Instrument and recording by name: ``count`` takes of the motion capture, one depth take, one
    force record.
    """
    dataset = settings.dataset
    arm, raw = arm_of(dataset.robot), Path(dataset.recordings)
    takes = sorted(file.stem for file in raw.glob(dataset.mocap.test))[:count]
    truth = contracts.read("true_joints", raw.parent / "truth")
    joints = contracts.read("joints", TRACK)
    first = joints[(joints.part == "training") & (joints.k == 0)]
    depth = depth_bench(
        takes[0],
        dataset,
        arm,
        truth,
        contracts.read("markers", INGEST),
        ArticulationOptions.chosen(settings.articulation),
        first[columns("q", dataset.robot.joints)].mean().to_numpy(),
    )
    benches = {take: (MOTION_CAPTURE, marker_bench(take, dataset, arm, truth)) for take in takes}
    return benches | {"depth": (DEPTH, depth), "force": (FORCE, force_bench(dataset))}


def _trial(trial: tuple[str, str, int], benches: dict[str, Bench], seed: int) -> dict[str, object]:
    name, fault, level = trial
    bench, kind = benches[name], FAULTS[fault]
    stream = rng.stream(seed, f"faults.{fault}", level, list(benches).index(name))
    outcome = suffer(bench, kind, kind.levels[level], stream)
    error = np.nan if outcome.recovered is None else bench.error(outcome.recovered)
    return {
        "fault": fault,
        "level": level,
        "outcome": outcome.kind,
        "said": outcome.said,
        "error": error,
        "clean": bench.error(bench.clean),
    }


def _summary(trials: pd.DataFrame) -> pd.DataFrame:
    """One row per fault and severity, over the trials."""
    return pd.DataFrame(
        [
            _row(FAULTS[name], level, rows)
            for (name, level), rows in trials.groupby(["fault", "level"], sort=False)
        ]
    )


def _row(fault: Fault, level: int, trials: pd.DataFrame) -> dict[str, object]:
    ends, kept = trials["outcome"].value_counts(), trials.dropna(subset="error")
    outcome = ends.index[0]
    if len(ends) > 1:
        outcome = ", ".join(f"{kind} {ends[kind]}" for kind in OUTCOMES if kind in ends)
    as_expected = set(ends.index) <= set(fault.expected)
    if not as_expected:
        print(
            f"faults: {fault.name} of {fault.levels[level]:g} {fault.severity} ended {outcome}, "
            f"where it should be {fault.expected}"
        )
    return {
        "fault": fault.name,
        "instrument": fault.instrument,
        "severity": float(fault.levels[level]),
        "severity_unit": fault.severity,
        "outcome": outcome,
        "as_expected": as_expected,
        "rule": fault.rule,
        "said": trials["said"].iloc[0],
        "error": _rms(kept["error"]),
        "clean_error": _rms((trials if kept.empty else kept)["clean"]),
        "error_unit": "N" if fault.instrument == FORCE else "rad",
    }


def _rms(errors: pd.Series) -> float:
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else np.nan
