"""readings: evidence under every other reading of "LU or QR" (Eq. LUDecom)."""

from functools import partial
from pathlib import Path

import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials
from pipeline.evidence.case import (
    WISHART,
    Camera,
    Choices,
    Recordings,
    readings,
    recorded_takes,
)
from pipeline.evidence.outcomes import evaluate
from pipeline.evidence.table import depends_on
from pipeline.filtering.measurement import measured_takes

OUT = Path("data/readings")


def run() -> None:
    """Fit, realise and filter the Wishart model under each reading that is not the run's, and write
    the evidence that depends on it, and the reasons for missing evidence.
    """
    settings = config.sections("readings")
    robot, motion = settings.dataset.robot, settings.dataset.motion
    with contracts.replacing(OUT) as folder:
        if robot is None:
            print(
                "readings: the dataset has no robot; there are no claims about its motion"
            )
            return
        base, takes = Choices.of_run(settings), recorded_takes(robot, motion)
        if not (
            cases := readings(base, takes.training.chain.task, takes.training.joints)
        ):
            return
        measured = {take.take: take for take in measured_takes(settings.dataset)}
        cameras = {base.clock: Camera(None, measured)} if measured else {}
        sizes = (motion.rate, len(measured), settings.simulation.realizations)
        recordings = Recordings(takes, cameras, *sizes, settings.seed, described=False)
        trials = partial(
            run_trials, compute=settings.compute, label="readings: models and filters"
        )
        own, *others = cases
        others = others[: settings.scale.readings]
        results = evaluate([cases[name] for name in others], recordings, trials)
        parts, reasons = [], [{"reading": own, "refused": ""}]
        for name, result in zip(others, results, strict=True):
            evidence = result.evidence
            for refusal in result.refusals:
                print(f"readings: {name}: {refusal}")
            parts.append(evidence[depends_on(evidence, WISHART)].assign(reading=name))
            reasons.append({"reading": name, "refused": "; ".join(result.refusals)})
        contracts.write(pd.concat(parts, ignore_index=True), "readings", folder)
        contracts.write(pd.DataFrame(reasons), "reading_refusals", folder)
