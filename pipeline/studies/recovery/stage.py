"""recovery: parameters that the estimators of the models return from data of known parameters."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.configuration import config
from pipeline.core import rng
from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.figures import style
from pipeline.models.bootstrap import replicate
from pipeline.models.draws import draw_steps
from pipeline.models.kinds import build_model, estimate, truths
from pipeline.models.model import MotionModel
from pipeline.models.steps import Options as Model
from pipeline.models.steps import Recorded, Truth
from pipeline.recordings.steps import training_steps
from pipeline.statistics.takes import NORMAL_QUANTILE, percentile_interval
from pipeline.studies.frame import NoAnswerError, Tables, number, trials

LOOKS = {  # estimators of σ_B
    "moments": {"label": "moments", "color": style.BLUE, "marker": "o"},
    "paper": {
        "label": "the paper's convex problem",
        "color": style.VERMILLION,
        "marker": "s",
    },
    "likelihood": {"label": "maximum likelihood", "color": style.ORANGE, "marker": "D"},
}
# estimates from a data set, and from one resampling of its takes
Pair = tuple[dict[str, float], dict[str, float]]


class KnownLaw(NamedTuple):
    """A law with known parameters, and the estimators by name that are tested on its data."""

    model: str
    truth: Truth
    estimators: dict[str, Model]


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the table ``recovery``; NoAnswerError if the measurement noise is unknown."""
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    # some takes and steps of the recordings with the measurement noise of all
    takes = slice(options.takes)
    steps = slice(None, None, options.stride)
    try:
        thinned = replace(
            recorded,
            q=recorded.q[takes, steps],
            v=recorded.v[..., steps, :],
            noise=recorded.noise[takes, steps],
            known_measurement=recorded.measurement,
        )
    except ModelDomainError as reason:
        raise NoAnswerError(reason.message) from None
    cases = list(known_laws(thinned, options))
    count = options.datasets
    data = [(case, i) for case in cases for i in range(count)]
    common = {"recorded": thinned, "seed": settings.seed}
    pairs = trials(settings, "recovery: data sets", recover, data, **common)
    rows = []
    for n, case in enumerate(cases):
        of_case = pairs[n * count :][:count]
        for name in case.estimators:
            of_estimator = [pair[name] for pair in of_case]
            place = {"model": case.model, "estimator": name}
            for parameter, truth in case.truth.values.items():
                row = recovery_row(parameter, truth, of_estimator)
                rows.append(place | {"parameter": parameter} | row)
    return {"recovery": pd.DataFrame(rows)}


def known_laws(recorded: Recorded, options: SimpleNamespace) -> Iterator[KnownLaw]:
    """Yield the laws of the data, with the recorded variance or a stated σ_B."""
    for name, model in config.model_options(options.estimators).items():
        names = options.estimators[name]
        estimators = {"–": model}
        if names:
            estimators = {x: replace(model, estimator=x) for x in names}
        for truth in truths(recorded, model, options.dispersions):
            yield KnownLaw(name, truth, estimators)


def draw_data(
    truth: MotionModel,
    recorded: Recorded,
    rng: np.random.Generator,
) -> Recorded:
    """Return ``recorded`` with the noise ω of every step drawn from ``truth`` plus N(0, Σ_m), the
    law that the likelihoods assume. Raises SingularJacobianError, and ModelDomainError without Σ_m.
    """
    q = recorded.q
    v = recorded.v
    step, _ = draw_steps(truth, recorded.chain, q, v, rng)
    zero = np.zeros(q.shape[-1])
    measured = rng.multivariate_normal(zero, recorded.measurement, q.shape[:-1])
    expected = q + recorded.chain.nominal_step(q, v)
    noise = step - expected + measured
    return replace(recorded, noise=noise, known_measurement=recorded.measurement)


def recover(
    trial: tuple[KnownLaw, int],
    recorded: Recorded,
    seed: int,
) -> dict[str, Pair | None]:
    """Return by estimator the estimates from a data set and from a resampling of its takes."""
    case, number = trial
    stream = f"recovery {case.truth.label}"
    law = build_model(case.truth.parameters)
    data = draw_data(law, recorded, rng.stream(seed, stream, number))
    pairs = {}
    for name, model in case.estimators.items():
        try:
            fit = estimate(data, model)
        except (ModelDomainError, SolverError):
            pairs[name] = None
            continue
        # the same resampling for every estimator
        takes = rng.stream(seed, stream, number, 1)
        again = replicate(data, model, fit.from_takes, takes)
        pairs[name] = None if again is None else (fit.estimates, again)
    return pairs


def recovery_row(
    parameter: str,
    truth: float,
    pairs: Sequence[Pair | None],
) -> dict[str, float]:
    """Return mean, error and coverage of a ``parameter`` over two or more data sets."""
    estimates = []
    again = []
    for pair in pairs:
        if pair and all(parameter in values for values in pair):
            estimates.append(pair[0][parameter])
            again.append(pair[1][parameter])
    count = len(estimates)
    row = {"truth": truth, "datasets": count, "lost": len(pairs) - count}
    if count < 2:
        return row
    estimates = np.array(estimates)
    again = np.array(again)
    mean = estimates.mean()
    std = estimates.std(ddof=1)
    half = NORMAL_QUANTILE * std / np.sqrt(count)
    error = estimates - truth
    low, high = percentile_interval(again - estimates)
    covered = (error + low <= 0) & (0 <= error + high)
    return row | {
        "mean": mean,
        "mean_low": mean - half,
        "mean_high": mean + half,
        "least": estimates.min(),
        "greatest": estimates.max(),
        "standard_deviation": std,
        "bootstrap_standard_error": (again - estimates).std(ddof=1),
        "coverage": np.mean(covered),
    }


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page: bias in percent and coverage of each estimator of σ_B."""
    rows = tables["recovery"]
    low = 100 * (rows["mean_low"] / rows["truth"] - 1)
    high = 100 * (rows["mean_high"] / rows["truth"] - 1)
    biases = map("{:+.2g} to {:+.2g} % at {:g}".format, low, high, rows["truth"])
    labels = {estimator: look["label"] for estimator, look in LOOKS.items()}
    rows = rows.assign(label=rows["estimator"].map(labels.get), bias=list(biases))
    of_sigma_b = rows["parameter"] == "sigma_b"
    wishart = rows[of_sigma_b]
    cells = []
    for row in wishart.itertuples():
        mean = f"{number(row.mean)} ({number(row.mean_low)} to {number(row.mean_high)})"
        errors = row.standard_deviation, row.bootstrap_standard_error
        numbers = map(number, (*errors, row.coverage, row.lost))
        cells.append((row.label, number(row.truth), mean, *numbers))
    further = rows[~of_sigma_b].dropna(subset="mean")
    unbiased = further["truth"].between(further["mean_low"], further["mean_high"])
    estimators = {}
    for label, of_label in wishart.groupby("label", sort=False):
        estimators[label] = of_label.dropna(subset="mean")
    return {
        "estimators": estimators,
        "cells": cells,
        "unbiased": unbiased.sum(),
        "others": len(further),
    }


def draw(recovery: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    recovery = recovery[recovery["parameter"] == "sigma_b"]
    figure, ((axes,),) = style.panels(style.ONE_COLUMN, 2.7)
    truths = list(recovery["truth"].unique())
    for shift, estimator in zip((-0.2, 0, 0.2), LOOKS, strict=True):
        rows = recovery[recovery["estimator"] == estimator]
        rows = rows.dropna(subset="mean")
        truth = rows["truth"]
        mean = rows["mean"] / truth
        below = mean - rows["least"] / truth
        above = rows["greatest"] / truth - mean
        x = truth.map(truths.index) + shift
        look = LOOKS[estimator] | {"ls": "", "ms": 4, "lw": 1.2}
        axes.errorbar(x, mean, yerr=(below, above), **look)
    axes.axhline(1, color=style.GREY, linewidth=0.8, zorder=0, label="true value")
    axes.set_xticks(range(len(truths)), [f"{truth:g}" for truth in truths])
    axes.set_xlabel(r"true $\sigma_B$ (1)")
    axes.set_ylabel(r"estimated over true $\sigma_B$ (1)")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
