"""baselines: the paper's models beside models without a random matrix that scale with the motion as
well: how they predict held-out steps, and what their filters' posteriors are worth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import MISSING

from pipeline.core import config, contracts
from pipeline.core.compute.trials import run_trials
from pipeline.models.closed_loop import mean_path
from pipeline.models.closed_loop_fit import closed_loop_of
from pipeline.models.commands import open_loop
from pipeline.models.kinds import estimate, fitted_model
from pipeline.models.model import MotionModel
from pipeline.models.options import Options as Model
from pipeline.models.prediction import groups_of_steps, score_take
from pipeline.models.steps import Estimate, Recorded
from pipeline.recordings.steps import training_steps
from pipeline.statistics.take_scores import (
    Scores,
    compared,
    log_score_differences,
    prediction_scores,
)
from pipeline.studies import page
from pipeline.studies.baselines.posteriors import Loops, filtered_scores
from pipeline.studies.baselines.words import FILTERED, FILTERED_CLOSED, TITLE, sections
from pipeline.verdicts.run import Run, read_runs

HERE = Path(__file__).parent
TRACK, FIT, OUT = Path("data/track"), Path("data/fit"), page.DATA / "baselines"
EVIDENT = ("model_scores", "log_score_differences")
EVIDENCE = page.REPORTS / "baselines"


@dataclass
class Options:
    """Models beside the run's own."""

    models: list[str] = MISSING  # option files of pipeline/conf/model


def run() -> None:
    """Score the one-step predictions and the filters of every model, and hold them against each
    other; the evidence of every dataset that was analysed stands on one page.
    """
    settings = config.sections("baselines", HERE / "dvc.yaml")
    names = config.study_options(HERE, Options).models
    beside = config.model_options([name for name in names if name not in settings.models])
    models = settings.models | beside
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    if np.all(np.any(recorded.v, axis=1)):
        print("baselines: the motion never rests: no measurement noise is known, nothing scored")
        tables = {}
    else:
        tables = _tables(settings, beside, recorded)
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("baselines", {}, settings.compute)
    runs = _beside_other_datasets(settings, recorded, models, tables)
    page.write_page("baselines", TITLE, sections(runs, names))


def _tables(settings, beside: Mapping[str, Model], recorded: Recorded) -> dict[str, pd.DataFrame]:
    """The study's tables by name."""
    joints = contracts.read("joints", TRACK)
    fits = {name: estimate(recorded, options) for name, options in beside.items()}
    fitted = {name: fitted_model(FIT / name) for name in settings.models}
    fitted |= {name: fit.model for name, fit in fits.items()}
    groups = _predicted(settings.models | beside, fitted, recorded, joints, settings)
    for steps, loops in _loops(beside, fits, recorded).items():
        closed, chosen = steps == FILTERED_CLOSED, list(settings.models)
        scores = filtered_scores(chosen, loops, closed, recorded, joints, settings)
        if scores:
            groups[steps] = scores
    parameters = [
        {"model": name, "parameter": key, "value": value}
        for name, fit in fits.items()
        for key, value in fit.estimates.items()
    ]
    return {
        "model_scores": _by_steps(
            {steps: compared(scores, next(iter(scores))) for steps, scores in groups.items()}
        ),
        "log_score_differences": _by_steps(
            {steps: log_score_differences(scores) for steps, scores in groups.items()}
        ),
        "baseline_fits": pd.DataFrame(parameters, columns=["model", "parameter", "value"]),
    }


def _loops(
    beside: Mapping[str, Model], fits: Mapping[str, Estimate], recorded: Recorded
) -> dict[str, Loops]:
    """Of either loop the models ``beside`` the run's, as fitted in it."""
    opened = {name: (fit.model, open_loop(recorded.v)) for name, fit in fits.items()}
    closed, path = {}, mean_path(recorded)
    for name, options in beside.items():
        fit, refused = closed_loop_of(recorded, options, fits[name])
        if fit is None:
            print(f"baselines: {name} has no closed loop: {refused}")
        else:
            closed[name] = (fit.estimate.model, path.commands(fit.share))
    return {FILTERED: opened, FILTERED_CLOSED: closed}


def _by_steps(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(tables, names=["steps"]).reset_index("steps")


def _predicted(
    models: Mapping[str, Model],
    fitted: Mapping[str, MotionModel],
    recorded: Recorded,
    joints: pd.DataFrame,
    settings,
) -> dict[str, dict[str, Scores]]:
    """Of every group of steps each model's scores."""
    training, test = joints[joints.part == "training"], joints[joints.part == "test"]
    if test.empty:
        print("baselines: no test takes: each take is predicted by the fit to the others")
    names, poses = contracts.stacked(training if test.empty else test, "q")
    trials = [(model, number) for model in models for number in range(len(names))]
    score = partial(
        score_take,
        takes=dict(enumerate(zip(names, poses, strict=True))),
        recorded=recorded,
        models=models if test.empty else fitted,
        seed=settings.seed,
    )
    scored = list(
        run_trials(score, trials, compute=settings.compute, label="baselines: predictions")
    )
    by_model, groups = {}, groups_of_steps(recorded, poses)
    for place, model in enumerate(models):
        own = scored[place * len(names) : (place + 1) * len(names)]
        by_model[model] = {key: np.stack([each[key] for each, _ in own]) for key in own[0][0]}
        for what in dict.fromkeys(what for _, reasons in own for what in reasons):
            said = [reasons[what] for _, reasons in own if what in reasons]
            takes = f"{len(said)} of {len(names)} takes"
            print(f"baselines: {model} gives no {what} in {takes}: {said[0]}")
    return {
        steps: {
            model: prediction_scores(
                {key: value[:, inside] for key, value in scores.items()},
                recorded.joints,
                moving=steps != "all",
            )
            for model, scores in by_model.items()
        }
        for steps, inside in groups.items()
    }


def _beside_other_datasets(
    settings, recorded: Recorded, models: Mapping[str, Model], tables: dict
) -> list[Run]:
    """This dataset's evidence, written, before that of the others."""
    dataset = settings.dataset
    here = Run(
        dataset=dataset.name,
        scale=settings.scale.name,
        synthetic=dataset.laboratory is not None,
        joints=recorded.joints,
        task=recorded.chain.task,
        models={name: options.kind for name, options in models.items()},
        metrics={},
        tables={name: tables[name] for name in EVIDENT if name in tables},
    )
    contracts.write_text(here.to_json(), EVIDENCE / f"{dataset.name}.json")
    return read_runs(EVIDENCE, first=dataset.name)
