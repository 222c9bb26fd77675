"""readings: verdicts of the claims under every reading of "LU or QR" (Eq. LUDecom)."""

from functools import partial
from pathlib import Path

from pipeline.cases.case import Choices, Recordings, camera_of, recorded_takes
from pipeline.cases.evidence import evaluate
from pipeline.cases.readings import read_claims, readings, readings_table
from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials

TRACK, ARTICULATE, OUT = Path("data/track"), Path("data/articulate"), Path("data/readings")


def run() -> None:
    """Fit, realise and filter the paper's models under each reading, and write the verdicts."""
    settings = config.sections("readings")
    robot, motion = settings.dataset.robot, settings.dataset.motion
    with contracts.replacing(OUT) as folder:
        if robot is None:
            print("readings: the dataset has no robot; there are no claims about its motion")
            return
        base = Choices.of_run(settings)
        takes, cameras = recorded_takes(robot, motion), {}
        cases = readings(base, takes.training.chain.task, takes.training.joints)
        if not cases:
            return
        if contracts.exists("angles", ARTICULATE):
            angles, joints = contracts.read("angles", ARTICULATE), contracts.read("joints", TRACK)
            window = settings.articulation.noise_window
            cameras[base.clock] = camera_of(angles, joints, window=window)
        filtered = sum(len(camera.takes) for camera in cameras.values())
        sizes = (motion.rate, filtered, settings.simulation.realizations)
        recordings = Recordings(takes, cameras, *sizes, (settings.seed, "readings"))
        trials = partial(run_trials, compute=settings.compute, label="readings: models and filters")
        results = evaluate(list(cases.values()), recordings, trials)
        evidence = dict(zip(cases, results, strict=True))
        for name, (_, refusals) in evidence.items():
            for refusal in refusals:
                print(f"readings: {name}: {refusal}")
        table = readings_table(read_claims(), evidence, takes.arm)
        contracts.write(table, "readings", folder)
