"""Joint error law on public recordings of three arms, held out by motion: σ, coverage and log score
half a second ahead, beside four simple predictions.
"""

import numpy as np
import pytest
from reference_errors import references
from source_code import ROOT

from pipeline.models.joint_error.fit import fit_joint_error
from pipeline.models.joint_error.held_out import parts_of, score_runs
from pipeline.models.joint_error.samples import counted, horizons
from pipeline.recordings.runs import joint_runs
from pipeline.tools.characterize.logs import folder_logs

# nats a sample, summed over joints, that the law may lose to the best of the four; measured: it
# gains at 0.1 s and 0.5 s, and loses .7 of 30.6 (kr300) and 2.4 of 98 (lwr4) at one sample
LOST = {"one sample": 3.0, "0.1 s": 0.5, "0.5 s": 0.5}


RECORDINGS = ROOT.parent / "shared/recordings"


@pytest.mark.slow
@pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"no recordings at {RECORDINGS}")
@pytest.mark.parametrize("arm", ["kr300", "lwr4", "ur5"])
def test_predictions_of_recorded_errors_are_calibrated_and_lose_to_no_simple_one(arm):
    logs = folder_logs(RECORDINGS / arm, {})
    runs = joint_runs(logs.movements, logs.rate).runs
    own, simple = {}, {}
    for others, held in parts_of(runs).values():
        for row in score_runs(fit_joint_error(others), held)[0]:
            if row["samples"] == "commanded":
                own.setdefault((row["horizon"], row["joint"]), []).append(row)
        for steps, horizon in zip(horizons(logs.rate), LOST, strict=True):
            for j, joint in enumerate(runs[0].joints):
                for name, predict in references(others, j, steps).items():
                    for run in (run for run in held if len(run.command) > steps + 1):
                        error = (run.measured - run.command)[steps:, [j]]
                        score = predict(run, steps).log_probability(error, run.quantum[[j]])
                        kept = score[counted(run, steps)[:, j], 0]
                        simple.setdefault((horizon, name, joint), []).append(kept)
    for horizon, allowed in LOST.items():
        total = 0.0
        for joint in runs[0].joints:
            rows = own[horizon, joint]
            weight = [row["count"] for row in rows]
            sizes = [
                np.average([row[name] ** 2 for row in rows], weights=weight)
                for name in ("predicted_rad", "measured_rad")
            ]
            assert 0.5 < np.sqrt(sizes[0] / sizes[1]) < 2.0, (horizon, joint)
            assert np.average([row["two_sigma"] for row in rows], weights=weight) > 0.8
            total += np.average([row["score"] for row in rows], weights=weight)
        names = {name for at, name, _ in simple if at == horizon}
        scores = {
            name: sum(
                np.concatenate(simple[horizon, name, joint]).mean() for joint in runs[0].joints
            )
            for name in names
        }
        assert total > max(scores.values()) - allowed, (horizon, total, scores)
        if horizon != "one sample":  # control: a constant about the command has a lower score
            assert total > scores["constant"] + 0.5
