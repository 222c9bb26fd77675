"""figures: the paper's figures and their captions, drawn from the tables of the other stages."""

from __future__ import annotations

import json
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from pipeline import config, contracts
from pipeline.compute.trials import run_trials
from pipeline.errors import ContractError
from pipeline.figures import (
    articulation,
    cable_robot,
    faults,
    filter_errors,
    joint_realizations,
    joint_std,
    kinect_noise,
    mean_error,
    model_scores,
    parameter_recovery,
    recording_quality,
    ridge,
    sensitivity,
    sigma_b_choices,
    wrench_density,
    wrench_error_histograms,
)
from pipeline.figures.style import save

TRACK, ARTICULATE, NOISE = Path("data/track"), Path("data/articulate"), Path("data/noise")
WRENCH, SCORE, OUT = Path("data/wrench"), Path("data/score"), Path("reports/figures")
SENSITIVITY = Path("data/sensitivity")
MOTION, FILTER, FORCE = (Path(f"reports/metrics/{name}.json") for name in ("motion", "filter", "wrench"))
RECOVER, FAULTS = Path("data/recover"), Path("data/faults")
DRAWN = 3  # models in the paper's figures
# tables that a dataset without the instrument does not have
INSTRUMENTS = {
    "cloud": "depth camera",
    "skeleton": "depth camera",
    "kinect_noise": "depth camera",
    "filter_error": "depth camera",
    "force_density": "force transducer",
    "model_scores": "time at rest",
    "parameter_recovery": "time at rest",
    "sigma_b_choices": "time at rest",
    "ridges": "fitted Gaussian matrix model",
    "faults": "synthetic laboratory",
}


class Sources(NamedTuple):
    """What a figure is made of: the module that draws it, the tables it shows, and the metrics stated beside it (their file and names)."""

    module: ModuleType
    tables: dict[str, Path]
    metrics: Path | None = None
    stated: tuple[str, ...] = ()


FIGURES = {
    "joint_realizations": Sources(joint_realizations, {"joints": TRACK, "process_noise": NOISE}),
    "mean_error": Sources(mean_error, {"deviation": SCORE}, MOTION, ("*_greatest_mean_error_rad",)),
    "joint_std": Sources(joint_std, {"deviation": SCORE}, MOTION, ("*_std_q?_rms_rad", "*_correlation_with_recorded")),
    "recording_quality": Sources(recording_quality, {"takes": TRACK}),
    "articulation": Sources(articulation, {"cloud": ARTICULATE, "skeleton": ARTICULATE}),
    "kinect_noise": Sources(kinect_noise, {"kinect_noise": NOISE}),
    "model_scores": Sources(model_scores, {"model_scores": SCORE}),
    "filter_errors": Sources(filter_errors, {"filter_error": SCORE}, FILTER, ("*_rms_error_rad", "*_coverage_*", "*_correlation_*")),
    "wrench_error_histograms": Sources(wrench_error_histograms, {"wrench_errors": WRENCH}, FORCE, ("study_*",)),
    "wrench_density": Sources(wrench_density, {"force_density": WRENCH}, FORCE, ("*_measured_*", "*_modelled_*")),
    "sensitivity": Sources(sensitivity, {"sensitivity": SENSITIVITY}),
    "parameter_recovery": Sources(parameter_recovery, {"parameter_recovery": RECOVER}),
    "sigma_b_choices": Sources(sigma_b_choices, {"sigma_b_choices": RECOVER}),
    "ridge": Sources(ridge, {"ridges": SCORE}),
    "faults": Sources(faults, {"faults": FAULTS}),
    "cable_robot": Sources(cable_robot, {}),
}


def run() -> None:
    """Draw every figure whose tables the dataset has, all or none of them into ``reports/figures``."""
    settings = config.sections("figures")
    # more lines than these cannot be told apart; the figure of the scores has all models
    models = list(settings.models)[:DRAWN]
    force = settings.dataset.force
    options = {
        "mean_error": {"models": models},
        "joint_std": {"models": models, "mode": settings.simulation.mode},
        "filter_errors": {"models": models},
        "ridge": {"models": list(settings.models)},
        "wrench_density": {"configurations": force.configurations if force else {}},
    }
    wanted = []
    for name, sources in FIGURES.items():
        lacking = {INSTRUMENTS[t] for t, place in sources.tables.items() if t in INSTRUMENTS and not contracts.exists(t, place)}
        if lacking:
            print(f"figures: {name} left out: the dataset has no {' and no '.join(sorted(lacking))}")
        else:
            wanted.append((name, options.get(name, {})))
    with contracts.replacing(OUT) as folder:
        captions = dict(run_trials(partial(_draw, folder=folder), wanted, compute=settings.compute, label="figures"))
        (folder / "captions.json").write_text(json.dumps(captions, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _draw(figure: tuple[str, dict], folder: Path) -> tuple[str, dict]:
    name, options = figure
    sources = FIGURES[name]
    tables = {table: contracts.read(table, place) for table, place in sources.tables.items()}
    save(sources.module.draw(**tables, **options), folder.resolve(), name)
    return name, _caption(sources)


def _caption(sources: Sources) -> dict:
    """What the module says it shows, the numbers other stages wrote on it, and where everything comes from."""
    title, _, text = " ".join(sources.module.__doc__.split()).partition(". ")
    files = [place / f"{table}.parquet" for table, place in sources.tables.items()]
    return {
        "title": title,
        "caption": text,
        "numbers": _stated(sources.metrics, sources.stated) if sources.metrics else {},
        "sources": [file.as_posix() for file in [*files, sources.metrics] if file],
        "script": sources.module.__name__.replace(".", "/") + ".py",
    }


def _stated(file: Path, patterns: tuple[str, ...]) -> dict:
    if not file.is_file():
        raise ContractError("there are no such metrics; run the stage that writes them", file=file)
    metrics = json.loads(file.read_text(encoding="utf-8"))
    stated = {key: value for key, value in metrics.items() if any(fnmatch(key, pattern) for pattern in patterns)}
    if not stated:
        raise ContractError(f"no number named like {' or '.join(patterns)}", file=file)
    return stated
