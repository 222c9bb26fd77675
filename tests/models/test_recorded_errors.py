"""Joint error law on public recordings of three arms, held out by motion: σ, coverage and log score
at three horizons, beside three simple predictions and a regression for each horizon.
"""

import pandas as pd
import pytest
from error_regression import regression_score
from source_code import ROOT

from pipeline.configuration.config import model_options
from pipeline.models.joint_error.choice import LAST_VALUE, pooled
from pipeline.models.joint_error.held_out import HORIZON_NAMES, MOVING, held_out
from pipeline.models.joint_error.samples import horizon_samples
from pipeline.recordings.runs import joint_runs
from pipeline.tools.characterize.logs import folder_logs
from pipeline.verdicts.deviations import deviations, losses

RECORDINGS = ROOT.parent / "shared/recordings"
LAW = "joint_error"
SIMPLE = ("joint_constant", "joint_autoregression", LAST_VALUE)
# predicted over measured σ; share in ±1σ
RATIO = (2 / 3, 3 / 2)
WITHIN = (0.58, 0.80)
WITHIN_TWO = (0.8, 1.0)  # share within ±2σ
LOST = 0.5  # nats a sample, summed over joints, that the law may lose to the best simple one
# Limits of what the card may name as an exception. The published angles of the LWR4+ were smoothed:
# over 60 rows at both ends of the log the error rings with up to 2.9 mrad, beside a median of
# .1 mrad. At one sample .90 and more of the errors are within ±1σ. Only one motion of the UR5 has
# jumps of joint_1: held out, σ is 1.54 times the measured.
FARTHEST_RATIO = (0.57, 1.6)
FARTHEST_WITHIN = (0.58, 0.95)
FARTHEST_LOST = 0.6
EXCEPTIONS = {"kr300": 2, "lwr4": 14, "ur5": 2}  # most joints and horizons named


def outside(joints: pd.DataFrame, column: str, band: tuple[float, float]) -> pd.Series:
    """Return the values of a column that are beyond the band."""
    values = joints[column]
    return values[~values.between(*band)]


@pytest.mark.slow
@pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"no recordings at {RECORDINGS}")
@pytest.mark.parametrize("arm", ["kr300", "lwr4", "ur5"])
def test_predictions_of_recorded_errors_are_calibrated_or_the_card_names_the_exception(
    arm,
):
    logs = folder_logs(RECORDINGS / arm, {})
    runs = joint_runs(logs.movements, logs.rate).runs
    laws = model_options(name for name in (LAW, *SIMPLE) if name != LAST_VALUE)
    scores = held_out(runs, laws)["joint_scores"]
    commanded = scores[scores["samples"] == MOVING]
    by_joint = pooled(commanded, ["model", "horizon", "joint"])
    totals = by_joint["score"].groupby(level=["model", "horizon"]).sum()
    named = {(row.horizon, row.joint) for row in deviations(scores, LAW)}
    sentences = " ".join(losses(scores, LAW))

    joints = by_joint.loc[LAW]
    beyond = {
        *outside(joints, "ratio", RATIO).index,
        *outside(joints, "one_sigma", WITHIN).index,
    }
    assert beyond == named
    assert len(named) <= EXCEPTIONS[arm]
    assert outside(joints, "ratio", FARTHEST_RATIO).empty, joints
    assert outside(joints, "one_sigma", FARTHEST_WITHIN).empty, joints
    assert outside(joints, "two_sigma", WITHIN_TWO).empty, joints

    for horizon, steps in zip(
        HORIZON_NAMES,
        horizon_samples(runs[0].rate),
        strict=True,
    ):
        score = totals[LAW, horizon]
        simple = {name: totals[name, horizon] for name in SIMPLE}
        lost = max(simple.values()) - score
        assert lost <= FARTHEST_LOST, (horizon, score, simple)
        assert (lost > LOST) == (f"At {horizon} " in sentences)
        # written without the law
        regression = regression_score(runs, steps)
        assert score > regression - LOST, (horizon, score, regression)
        if horizon != HORIZON_NAMES[0]:  # control: a constant has a lower score
            assert score > simple["joint_constant"] + LOST
