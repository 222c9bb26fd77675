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
    chosen, every, count = (
        slice(options.takes),
        slice(None, None, options.stride),
        options.datasets,
    )
    try:  # some takes and steps of the recordings with the measurement noise of all
        part = replace(
            recorded,
            q=recorded.q[chosen, every],
            v=recorded.v[..., every, :],
            noise=recorded.noise[chosen, every],
            known_measurement=recorded.measurement,
        )
    except ModelDomainError as reason:
        raise NoAnswerError(reason.message) from None
    cases = list(known_laws(part, options))
    data = [(case, i) for case in cases for i in range(count)]
    common = {"recorded": part, "seed": settings.seed}
    pairs = trials(settings, "recovery: data sets", recover, data, **common)
    rows = [
        {"model": case.model, "estimator": name, "parameter": parameter}
        | recovery_row(
            parameter, truth, [pair[name] for pair in pairs[n * count :][:count]]
        )
        for n, case in enumerate(cases)
        for name in case.estimators
        for parameter, truth in case.truth.values.items()
    ]
    return {"recovery": pd.DataFrame(rows)}


def known_laws(recorded: Recorded, options: SimpleNamespace) -> Iterator[KnownLaw]:
    """Yield the laws of the data, with the recorded variance or a stated σ_B."""
    for name, model in config.model_options(options.estimators).items():
        names = options.estimators[name]
        estimators = {each: replace(model, estimator=each) for each in names} or {
            "–": model
        }
        for truth in truths(recorded, model, options.dispersions):
            yield KnownLaw(name, truth, estimators)


def draw_data(
    truth: MotionModel, recorded: Recorded, rng: np.random.Generator
) -> Recorded:
    """Return ``recorded`` with the noise ω of every step drawn from ``truth`` plus N(0, Σ_m), the
    law that the likelihoods assume. Raises SingularJacobianError, and ModelDomainError without Σ_m.
    """
    q, v = recorded.q, recorded.v
    step, _ = draw_steps(truth, recorded.chain, q, v, rng)
    measured = rng.multivariate_normal(
        np.zeros(q.shape[-1]), recorded.measurement, q.shape[:-1]
    )
    noise = step - (q + recorded.chain.nominal_step(q, v)) + measured
    return replace(recorded, noise=noise, known_measurement=recorded.measurement)


def recover(
    trial: tuple[KnownLaw, int], recorded: Recorded, seed: int
) -> dict[str, Pair | None]:
    """Return by estimator the estimates from a data set and from a resampling of its takes."""
    case, number = trial
    stream = f"recovery {case.truth.label}"
    law = build_model(case.truth.parameters)
    data, pairs = draw_data(law, recorded, rng.stream(seed, stream, number)), {}
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
    parameter: str, truth: float, pairs: Sequence[Pair | None]
) -> dict[str, float]:
    """Return mean, error and coverage of a ``parameter`` over two or more data sets."""
    given = [pair for pair in pairs if pair and all(parameter in part for part in pair)]
    row = {"truth": truth, "datasets": len(given), "lost": len(pairs) - len(given)}
    if len(given) < 2:
        return row
    estimates, again = np.array(
        [[part[parameter] for part in pair] for pair in given]
    ).T
    error, mean, std = estimates - truth, estimates.mean(), estimates.std(ddof=1)
    half = NORMAL_QUANTILE * std / np.sqrt(len(estimates))
    low, high = percentile_interval(again - estimates)
    return row | {
        "mean": mean,
        "mean_low": mean - half,
        "mean_high": mean + half,
        "least": estimates.min(),
        "greatest": estimates.max(),
        "standard_deviation": std,
        "bootstrap_standard_error": (again - estimates).std(ddof=1),
        "coverage": np.mean((error + low <= 0) & (0 <= error + high)),
    }


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page: bias in percent and coverage of each estimator of σ_B."""
    rows = tables["recovery"]
    ends = [100 * (rows[end] / rows["truth"] - 1) for end in ("mean_low", "mean_high")]
    rows = rows.assign(
        label=rows["estimator"].map(lambda name: LOOKS.get(name, {}).get("label")),
        bias=[*map("{:+.2g} to {:+.2g} % at {:g}".format, *ends, rows["truth"])],
    )
    wishart, others = (
        rows[rows["parameter"] == "sigma_b"],
        rows[rows["parameter"] != "sigma_b"],
    )
    columns = ["truth", "mean", "mean_low", "mean_high", "standard_deviation"]
    columns += ["bootstrap_standard_error", "coverage", "lost"]
    cells = [
        (name, truth, f"{mean} ({low} to {high})", *further)
        for name, truth, mean, low, high, *further in (
            wishart.set_index("label")[columns].map(number).itertuples()
        )
    ]
    others = others.dropna(subset="mean")
    parts = wishart.groupby("label", sort=False)
    return {
        "estimators": {name: part.dropna(subset="mean") for name, part in parts},
        "cells": cells,
        "unbiased": others["truth"]
        .between(others["mean_low"], others["mean_high"])
        .sum(),
        "others": len(others),
    }


def draw(recovery: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    recovery = recovery[recovery["parameter"] == "sigma_b"]
    figure, ((axes,),) = style.panels(style.ONE_COLUMN, 2.7)
    places = {
        truth: place for place, truth in enumerate(dict.fromkeys(recovery["truth"]))
    }
    for shift, (estimator, look) in zip((-0.2, 0, 0.2), LOOKS.items(), strict=True):
        rows = recovery[recovery["estimator"] == estimator].dropna(subset="mean")
        x = rows["truth"].map(places) + shift
        mean, least, greatest = (
            rows[c] / rows["truth"] for c in ("mean", "least", "greatest")
        )
        axes.errorbar(
            x, mean, yerr=(mean - least, greatest - mean), ls="", ms=4, lw=1.2, **look
        )
    axes.axhline(1, color=style.GREY, linewidth=0.8, zorder=0, label="true value")
    axes.set_xticks(list(places.values()), [f"{truth:g}" for truth in places])
    axes.set(
        xlabel=r"true $\sigma_B$ (1)", ylabel=r"estimated over true $\sigma_B$ (1)"
    )
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
