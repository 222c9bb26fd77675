"""Noise of a step in logs: known covariances come out, whatever the rate of the rows, and one run
decides whether the noise grows with the speed.
"""

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng

from pipeline.evidence.step_noise import noise_by_speed, run_evidence, step_noise
from pipeline.models.joint_error.samples import JointRun
from pipeline.verdicts import decision as d
from pipeline.verdicts.claims import read_claims
from pipeline.verdicts.run import ArmNames

JOINTS = ("a", "b")

NOISE = [[4e-6, 1e-6], [1e-6, 1e-6]]  # rad²
COUNT = 20_000  # steps of 10 ms


@pytest.fixture(params=[100.0, 500.0])
def rows(request) -> pd.DataFrame:
    """Noise of steps with the covariance NOISE each 10 ms, and of a joint that rests; the first
    half of the run is slow.
    """
    rate = request.param
    rng = default_rng(3)
    every = round(0.01 * rate)
    samples = every * COUNT

    drawn = rng.multivariate_normal([0, 0], NOISE, COUNT)
    errors = np.empty((samples, 3))
    errors[:, :2] = np.repeat(np.cumsum(drawn, axis=0), every, axis=0)
    errors[:, 2] = rng.normal(0, 1e-3, samples)

    steps = np.zeros((samples, 3))
    steps[:, :2] = 0.1 / rate
    steps[samples // 2 :, :2] = 0.4 / rate
    command = np.cumsum(steps, axis=0)

    recorded = "run", rate, command, command + errors, ("a", "b", "rests")
    run = JointRun(*recorded, np.zeros(3), np.zeros(3), 1e-6, "1")
    return step_noise([run]).set_index(["joint", "other", "steps"])


def test_the_noise_of_a_step_has_the_covariance_of_the_drawn_errors(rows):
    covariance = rows["covariance"]

    assert "rests" not in rows.index.get_level_values("joint")
    for pair, expected in ((("a", "a"), 4e-6), (("a", "b"), 1e-6), (("b", "b"), 1e-6)):
        assert covariance[(*pair, "all")] == pytest.approx(expected, rel=0.06)
    # white noise knows of no earlier step, and its size is the same at any speed
    assert abs(rows.loc[("a", "a", "successive"), "correlation"]) < 0.03
    slow, fast = (covariance[("a", "a", half)] for half in ("slow", "fast"))
    assert slow == pytest.approx(fast, rel=0.1)


def one_run(seconds: float, fast: float, burst: float = 1.0) -> JointRun:
    """Return a run of two joints at 500 Hz. The errors of their steps of 10 ms are ``fast`` times
    as large at fast steps, and ``burst`` times in the second fifth of the run.
    """
    rng = np.random.default_rng(8)
    count = round(100 * seconds)
    t = np.arange(count + 1) / 100
    command = 0.5 * np.sin(0.4 * np.pi * t[:, None] + [0.0, 1.0])
    speeds = np.abs(np.diff(command, axis=0))
    scale = np.where(speeds > np.median(speeds, axis=0), fast, 1.0)
    scale[count // 5 : 2 * count // 5] *= burst
    steps = 1e-3 * scale * rng.standard_normal((count, 2))
    error = np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    command, error = (np.repeat(rows, 5, axis=0) for rows in (command, error))
    unused = {"lag": np.zeros(2), "quantum": np.zeros(2), "pose_noise": None}
    return JointRun(
        "run",
        500.0,
        command,
        command + error,
        JOINTS,
        motion="1",
        **unused,
    )


@pytest.mark.parametrize(
    ("run", "verdict"),
    [
        (one_run(seconds=40, fast=3.0), d.REPRODUCED),
        (one_run(seconds=40, fast=0.3), d.REPRODUCED),
        (one_run(seconds=100, fast=1.0), d.NOT_REPRODUCED),
        # without power
        (one_run(seconds=2, fast=3.0), d.NO_EVIDENCE),
        # what happened once is no property of the motion
        (one_run(seconds=40, fast=1.0, burst=10.0), d.NO_EVIDENCE),
    ],
    ids=["grows", "falls", "constant", "short", "burst"],
)
def test_one_run_decides_whether_the_noise_is_dynamic(run, verdict):
    claims = [claim for claim in read_claims() if claim.id == "noise-is-dynamic"]
    evidence = run_evidence(noise_by_speed([run]))
    decided = d.decide(claims, evidence, "real", ArmNames(JOINTS, ()))[0]
    assert decided.verdict == verdict
    assert len(decided.cases) == len(JOINTS)
    assert all(0 <= case.power <= 1 for case in decided.cases)


def test_the_power_of_a_short_run_is_low_and_of_a_long_run_high():
    short, long = (noise_by_speed([one_run(s, fast=1.0)])["power"] for s in (3, 100))
    assert short.max() < 0.5
    assert long.min() > 0.9
