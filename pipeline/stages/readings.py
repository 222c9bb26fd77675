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
    Takes,
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
    with contracts.replacing(OUT) as folder:
        if settings.dataset.robot is None:
            print(
                "readings: the dataset has no robot; there are no claims about its motion",
            )
            return
        base = Choices.of_run(settings)
        takes = recorded_takes(settings.dataset.robot, settings.dataset.motion)
        task = takes.training.chain.task
        joints = takes.training.joints
        cases = readings(base, task, joints)
        if not cases:
            return
        of_run, *names = cases
        names = names[: settings.scale.readings]
        trials = partial(
            run_trials,
            compute=settings.compute,
            label="readings: models and filters",
        )
        recordings = _recordings(settings, base, takes)
        results = evaluate([cases[name] for name in names], recordings, trials)
        tables = []
        reasons = [{"reading": of_run, "refused": ""}]
        for name, result in zip(names, results, strict=True):
            for refusal in result.refusals:
                print(f"readings: {name}: {refusal}")
            evidence = result.evidence
            of_wishart = evidence[depends_on(evidence, WISHART)]
            tables.append(of_wishart.assign(reading=name))
            reasons.append({"reading": name, "refused": "; ".join(result.refusals)})
        contracts.write(pd.concat(tables, ignore_index=True), "readings", folder)
        contracts.write(pd.DataFrame(reasons), "reading_refusals", folder)


def _recordings(settings, base: Choices, takes: Takes) -> Recordings:
    """Return the takes with the measurements that the filter of the run's choices ``base`` uses."""
    measured = {take.take: take for take in measured_takes(settings.dataset)}
    cameras = {base.clock: Camera(None, measured)} if measured else {}
    return Recordings(
        takes,
        cameras,
        rate=settings.dataset.motion.rate,
        filtered=len(measured),
        realizations=settings.simulation.realizations,
        seed=settings.seed,
        described=False,
    )
