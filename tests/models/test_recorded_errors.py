"""Joint error law on public recordings of three arms, held out by motion: σ, coverage and log score
at three horizons, beside three simple predictions.
"""

import pandas as pd
import pytest
from source_code import ROOT

from pipeline.configuration.config import model_options
from pipeline.models.joint_error.choice import LAST_VALUE, pooled
from pipeline.models.joint_error.held_out import HORIZON_NAMES, MOVING, held_out
from pipeline.recordings.runs import joint_runs
from pipeline.tools.characterize.logs import folder_logs

RECORDINGS = ROOT.parent / "shared/recordings"
LAW, SIMPLE = "joint_error", ("joint_constant", "joint_autoregression", LAST_VALUE)
RATIO = (2 / 3, 3 / 2)  # predicted over measured σ
WITHIN, WITHIN_TWO = (0.58, 0.80), (0.8, 1.0)  # share within ±1σ and ±2σ
LOST = 0.5  # nats a sample, summed over joints, that the law may lose to the best simple one
# The autoregression is fitted to one sample only, the law to three horizons: on the KR 300 the law
# has .52 nats less at one sample.
OTHER_LOST = {("kr300", "one sample"): 0.6}
# arm, horizon → other bands. The published angles of the LWR4+ were smoothed: over 60 rows at both
# ends of the log the error rings with up to 2.9 mrad, beside a median of .1 mrad. At one sample .96
# and more of the errors lie within their own standard deviation (kurtosis above 150): no law has
# both the right σ and .68 within it. At .1 s the ringing makes the measured σ.
OTHER_RATIO = {("lwr4", "0.1 s"): (0.57, 3 / 2)}
OTHER_WITHIN = {("lwr4", "one sample"): (0.58, 0.95)}
# only one motion of the UR5 has jumps of joint_1. Without it the variance after a jump is the mean
# of the other joints: σ is 1.54 times the measured at one sample, .88 and .91 at .1 and .5 s
OTHER_RATIO |= {("ur5", "one sample"): (2 / 3, 1.6)}


def outside(joints: pd.DataFrame, column: str, band: tuple[float, float]) -> pd.Series:
    """Return by joint the values of a column that are beyond the band."""
    values = joints[column]
    return values[~values.between(*band)]


@pytest.mark.slow
@pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"no recordings at {RECORDINGS}")
@pytest.mark.parametrize("arm", ["kr300", "lwr4", "ur5"])
def test_predictions_of_recorded_errors_are_calibrated_and_lose_to_no_simple_one(arm):
    logs = folder_logs(RECORDINGS / arm, {})
    runs = joint_runs(logs.movements, logs.rate).runs
    laws = model_options(name for name in (LAW, *SIMPLE) if name != LAST_VALUE)
    scores = held_out(runs, laws)["joint_scores"]
    commanded = scores[scores["samples"] == MOVING]
    by_joint = pooled(commanded, ["model", "horizon", "joint"])
    totals = by_joint["score"].groupby(level=["model", "horizon"]).sum()

    for horizon in HORIZON_NAMES:
        joints = by_joint.loc[(LAW, horizon)]
        within = OTHER_WITHIN.get((arm, horizon), WITHIN)
        assert outside(joints, "one_sigma", within).empty, joints
        assert outside(joints, "two_sigma", WITHIN_TWO).empty, joints
        ratio = OTHER_RATIO.get((arm, horizon), RATIO)
        assert outside(joints, "ratio", ratio).empty, joints

        score = totals[LAW, horizon]
        simple = {name: totals[name, horizon] for name in SIMPLE}
        lost = OTHER_LOST.get((arm, horizon), LOST)
        assert score > max(simple.values()) - lost, (horizon, score, simple)
        if horizon != HORIZON_NAMES[0]:  # control: a constant has a lower score
            assert score > simple["joint_constant"] + LOST
