"""Joint error law: predictions at any horizon, draws, cells of quantised angles, recovery by its
fit, and scores on held-out motions.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from error_runs import MEMORY, RATE, jumping_runs, known_law, runs_of_law, sweep
from numpy.random import default_rng
from scipy.stats import norm
from scipy.stats import t as student

from pipeline.core.delays import delayed_angles
from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_error.choice import pooled
from pipeline.models.joint_error.drive import GROWTH, INPUTS, JUMPS
from pipeline.models.joint_error.fit import fit_joint_error
from pipeline.models.joint_error.held_out import (
    law_numbers,
    of_first_motions,
    parts_of,
    score_runs,
)
from pipeline.models.joint_error.law import JointErrorModel, build
from pipeline.models.joint_error.likelihood import (
    CALIBRATION,
    NoiseLaw,
    Residuals,
    composite_loss,
)
from pipeline.models.joint_error.outlook import Outlook
from pipeline.models.joint_error.samples import (
    JointRun,
    lags_of_logs,
    lasting_speeds,
    settled,
)
from pipeline.models.joint_error.search import JUMP_INPUTS

LAWS = {
    "normal": known_law(),
    "tails and drift": known_law(
        degrees=np.array([5.0, 8.0]),
        drift=np.array([0.3, 0.1]),
    ),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("steps", [1, 10, 50])
def test_draws_have_the_mean_and_the_variance_of_the_prediction(name, steps):
    law = LAWS[name]
    rng = default_rng(5)
    start = 200
    draws = 4000
    command = sweep(1)[: start + steps + 1]
    dq = np.diff(command, axis=0)
    q = np.tile(command[0], (draws, 1))
    memory = law.first_memory(q, command[0], rng)
    path = [q[0]]
    for step in dq[:start]:
        q, memory = law.follow(q, step, memory, rng)
        # all draws have one past
        q[:] = q[:1]
        memory[:] = memory[:1]
        path.append(q[0])
    drift = np.split(memory, 10, axis=-1)[-1]
    drift[:] = rng.standard_normal(drift.shape)  # which the errors do not show
    errors = np.stack(path) - command[: start + 1]
    for step in dq[start:]:
        q, memory = law.follow(q, step, memory, rng)
    drawn = q - command[start + steps]

    mean, covariance = law.predict(errors, command, steps)

    std = np.sqrt(np.diag(covariance))
    # five standard errors; the kurtosis of t with 5 degrees of freedom is 9
    assert np.all(np.abs(drawn.mean(axis=0) - mean) < 5 * std / np.sqrt(draws))
    np.testing.assert_allclose(drawn.std(axis=0), std, rtol=5 * np.sqrt(8 / draws / 4))
    if steps == 50:  # control: the persistent law with equal innovations differs
        persistent = np.tile([1.0, 0.0, 0.0], (2, 1))
        differing = replace(law, memory=persistent, drift=np.zeros(2))
        _, covariance = differing.predict(errors, command, steps)
        ratio = np.sqrt(np.diag(covariance)) / drawn.std(axis=0)
        assert np.any(np.abs(np.log(ratio)) > 0.3)


def test_predictions_of_a_whole_run_are_those_of_each_sample():
    law = LAWS["tails and drift"]
    rng = default_rng(6)
    (run,) = runs_of_law(law, rng, motions=1, repeats=1)
    error = run.measured - run.command
    command = run.command
    steps = 7
    outlook = law.outlook(error, law.inputs(command), steps)
    for k in (50, 200, 431):
        count = k + 1
        mean, covariance = law.predict(error[:count], command[: count + steps], steps)
        np.testing.assert_allclose(outlook.mean[k], mean, atol=1e-15)
        np.testing.assert_allclose(outlook.variance[k], np.diag(covariance), rtol=1e-12)
    # more commands than needed change nothing; with fewer there is no prediction
    mean, _ = law.predict(error[:60], command[:67], steps)
    with_more, _ = law.predict(error[:60], command, steps)
    np.testing.assert_array_equal(with_more, mean)
    with pytest.raises(ModelDomainError, match="the 7 next samples, got 8"):
        law.predict(error[:3], command[:8], steps)


def test_a_law_comes_back_from_its_plain_parameters():
    for law in (LAWS["tails and drift"], known_law(power=1.0)):
        assert build(law.parameters()).parameters() == law.parameters()


@pytest.mark.parametrize("degrees", [np.inf, 4.5])
def test_the_cells_of_quantised_angles_have_probability_one_together(degrees):
    law = Outlook(np.array([3e-5]), np.array([1e-9]), np.array([degrees]))
    numbers = np.arange(-20000, 20001)[:, None]
    for quantum in (1e-6, 5e-5, 2e-3):
        density = np.exp(law.log_probability(quantum * numbers, np.array([quantum])))
        assert quantum * density.sum() == pytest.approx(1.0, abs=1e-4)
    # a narrow cell has the density of its middle
    error = np.array([[5e-5]])
    narrow = law.log_probability(error, np.array([1e-9]))
    exact = law.log_probability(error, np.array([0.0]))
    assert narrow == pytest.approx(exact, abs=1e-4)


@pytest.mark.parametrize("name", LAWS)
def test_the_compiled_loss_is_that_of_the_laws_own_predictions(name):
    law = LAWS[name]
    (run,) = runs_of_law(law, default_rng(6), motions=1, repeats=1)
    error = run.measured - run.command
    inputs = law.inputs(run.command)
    past = law.residuals(error, inputs)
    horizons = [1, 10, 50]
    least = 1e-11
    ends = [np.arange(60, 600, 7), np.arange(60, 600, 9), np.arange(60, 600, 11)]
    for j in range(2):
        expected = 0.0
        degrees = law.degrees[j]
        factor = 1.0
        density = norm
        if np.isfinite(degrees):
            factor = 1 - 2 / degrees
            density = student(df=degrees)
        for steps, samples in zip(horizons, ends, strict=True):
            outlook = law.outlook(error, inputs, steps)
            off = (error[steps:] - outlook.mean)[samples - steps, j]
            variance = outlook.variance[samples - steps, j]
            scale = np.sqrt(variance * factor + least)
            expected -= np.mean(density.logpdf(off / scale) - np.log(scale))
            sizes = variance.mean() + least, np.mean(off**2) + least
            expected += CALIBRATION * np.log(sizes[0] / sizes[1]) ** 2
        noise = NoiseLaw(law.memory[j], law.scale[j], law.drift[j], law.degrees[j])
        residuals = Residuals(
            r=past[:, j, 0],
            past=past[:, j],
            growth=inputs.growth[:, j].copy(),
            horizons=np.array(horizons),
            ends=np.concatenate(ends),
            counts=np.array([len(samples) for samples in ends]),
            least=least,
        )
        loss = composite_loss(noise, law.keep, law.persistence, residuals)
        assert loss == pytest.approx(expected, rel=1e-9)


def commanded_rows(law: JointErrorModel, runs: Sequence[JointRun]) -> list[dict]:
    """Return the scores of all commanded samples of ``runs``."""
    rows, _ = score_runs(law, runs)
    return [row for row in rows if row["samples"] == "commanded"]


def test_the_memory_of_a_known_law_is_recovered_and_predicts_fresh_runs():
    law = known_law()
    rng = default_rng(7)
    fitted = fit_joint_error(runs_of_law(law, rng), tails=False)
    # 300 samples by horizon: about .06 a coefficient; .2 is three standard errors of a response
    impulse = fitted.response(50)[1]
    true_impulse = law.response(50)[1]
    np.testing.assert_allclose(impulse[:10], true_impulse[:10], atol=0.2)
    # control: the errors do not persist
    assert np.abs(MEMORY - [1.0, 0.0, 0.0]).max() > 0.4
    for row in commanded_rows(fitted, runs_of_law(law, rng)):
        assert 0.85 < row["predicted_rad"] / row["measured_rad"] < 1.18, row
        assert abs(row["one_sigma"] - 0.683) < 0.06, row
        assert row["two_sigma"] > 0.92, row
    # control: a law without memory is too wide half a second ahead
    white = fit_joint_error(runs_of_law(law, rng), memory="persistent", tails=False)
    rows = pd.DataFrame(commanded_rows(white, runs_of_law(law, rng)))
    far = rows[rows["horizon"] == "0.5 s"]
    assert (far["predicted_rad"] / far["measured_rad"]).max() > 1.5


@pytest.mark.slow
def test_sigma_at_the_horizons_is_determined_and_memory_and_sigma_at_full_speed_are_not():
    """Errors fade in 0.095 s, and their variance grows with the square of the speed."""
    decay = 0.095
    fade = np.exp(-1 / (RATE * decay))
    scale = np.zeros((2, len(GROWTH)))
    scale[:, GROWTH.index("rest")] = 1e-10
    scale[:, GROWTH.index("growth")] = (384e-6) ** 2 * (1 - fade**2)
    memory = np.tile([fade, 0.0, 0.0], (2, 1))
    law = known_law(memory=memory, scale=scale, power=2.0, reach=np.ones(2))
    runs = runs_of_law(law, default_rng(1), motions=6, repeats=20)
    fresh = runs_of_law(law, default_rng(2), motions=6, repeats=2)

    fitted = fit_joint_error(runs, tails=False)
    rows = pd.DataFrame(commanded_rows(fitted, fresh))
    ratio = rows["predicted_rad"] / rows["measured_rad"]
    assert ratio.between(0.85, 1.15).all()
    # more runs do not tell the time of the memory, of which parts make up for each other
    numbers = law_numbers(fitted)
    assert numbers["decay_s"].max() > 1.25 * decay
    # nor the end of a curve of another shape
    at_full_speed = known_law(
        **{name: getattr(law, name) for name in ("memory", "scale", "power")},
        reach=fitted.reach,
    )
    column = "innovation_at_greatest_speed_rad"
    low = numbers[column] / law_numbers(at_full_speed)[column]
    assert low.between(0.6, 0.8).all()
    # control: with the shape of the variance, that end is determined
    shaped = law_numbers(fit_joint_error(runs, tails=False, power=2.0))
    right = shaped[column] / law_numbers(at_full_speed)[column]
    assert right.between(0.9, 1.1).all()


def test_predictions_of_rounded_angles_include_the_rounding():
    quantum = np.full(2, 1e-3)  # the errors before rounding are of some 1e-4 rad

    def rounded_runs(seed: int) -> list[JointRun]:
        runs = []
        for run in runs_of_law(known_law(), default_rng(seed)):
            rounded = quantum * np.round(run.measured / quantum)
            runs.append(replace(run, measured=rounded, quantum=quantum))
        return runs

    law = fit_joint_error(rounded_runs(8), tails=False)
    fresh = rounded_runs(9)
    for row in commanded_rows(law, fresh):
        # without the variance of the rounding a ratio would be below 0.8
        assert 0.85 < row["predicted_rad"] / row["measured_rad"] < 1.3, row
        assert row["two_sigma"] > 0.92, row
    command = fresh[0].command[:10]
    error = (fresh[0].measured[:10] - command)[:9]
    _, covariance = law.predict(error, command, 1)
    assert np.all(np.diag(covariance) > 1e-6 / 12)


def test_samples_after_a_jump_of_the_commanded_speed_are_not_settled():
    smooth_start = np.clip(np.arange(300) - 50, 0, 40) / 40
    command = 1e-3 * np.cumsum(smooth_start)[:, None]
    assert settled(command, 100.0).all()
    command[200:] = command[200]  # from full speed to rest within a sample
    calm = settled(command, 100.0)
    assert calm[:200].all()
    assert not calm[202:258].any()
    assert calm[270:].all()


def test_the_law_is_right_after_jumps_of_the_commanded_speed():
    rng = default_rng(3)
    runs = jumping_runs(rng)
    fresh = jumping_runs(rng)
    law = fit_joint_error(runs, tails=False)
    rows = pd.DataFrame(score_runs(law, fresh)[0])
    for kind in ("commanded", "settled"):
        by_joint = pooled(rows[rows["samples"] == kind], ["joint", "horizon"])
        assert by_joint["ratio"].between(0.6, 1.8).all(), (kind, by_joint["ratio"])
    commanded = rows[rows["samples"] == "commanded"]
    error = pooled(commanded, ["horizon"])["measured_rad"]["0.5 s"]
    about_command = [(run.measured - run.command)[run.moving] for run in fresh]
    assert error < 0.5 * np.sqrt(np.mean(np.concatenate(about_command) ** 2))
    # control: without what a jump adds, the law has twice the error
    gain = law.mean_gain.copy()
    scale = law.scale.copy()
    gain[:, -2:] = 0.0
    scale[:, JUMPS] = 0.0
    blind = replace(law, mean_gain=gain, scale=scale)
    rows = pd.DataFrame(commanded_rows(blind, fresh))
    blind_error = pooled(rows, ["horizon"])["measured_rad"]["0.5 s"]
    assert blind_error > 2 * error


def test_a_jump_of_the_speed_counts_whole_and_is_no_acceleration():
    law = known_law(jump=np.array([5.0, 5.0]))
    change = np.array([4.9, 5.1])  # rad/s², just below and just above the bound
    command = np.zeros((4, 2))
    command[2:] = change / RATE**2 * np.array([[1.0], [2.0]])
    drive = law.inputs(command)
    acceleration = drive.mean[2, :, INPUTS.index("acceleration")]
    np.testing.assert_allclose(acceleration, [4.9, 0.0])
    np.testing.assert_allclose(
        drive.growth[2, :, JUMPS],
        [0.0, (5.1 / RATE) ** 2],
        atol=1e-15,
    )


def runs_of_three_joints(rng: np.random.Generator) -> list[JointRun]:
    """Return :func:`jumping_runs` with a third joint whose speed does not jump."""
    runs = []
    for run, smooth in zip(
        jumping_runs(rng),
        runs_of_law(known_law(), rng),
        strict=True,
    ):
        three = {"joints": ("a", "b", "c"), "lag": np.zeros(3), "quantum": np.zeros(3)}
        for name in ("command", "measured"):
            jumping = getattr(run, name)
            still = getattr(smooth, name)
            three[name] = np.concatenate([jumping, still[:, :1]], axis=1)
        runs.append(replace(run, **three))
    return runs


def test_a_joint_without_jumps_has_the_mean_variance_of_the_others_after_one():
    runs = runs_of_three_joints(default_rng(3))
    variance = fit_joint_error(runs, memory="persistent", tails=False).scale[:, JUMPS]
    assert variance[2] == pytest.approx(variance[:2].mean())
    assert abs(np.log(variance[0] / variance[1])) > 1e-3  # control: they differ


def test_the_errors_of_a_joint_without_jumps_have_the_whole_size_after_one():
    law = fit_joint_error(runs_of_three_joints(default_rng(3)), tails=False)
    variance = law.scale[:, JUMPS]
    # the others have a mean response to a jump, and a variance of what it leaves
    assert np.all(law.mean_gain[:2, INPUTS.index("fresh jumps")] < 0)
    assert variance[2] > 10 * variance[:2].max()


def test_runs_of_the_only_motion_with_jumps_determine_the_response_to_one():
    rng = default_rng(3)
    jumping = jumping_runs(rng, motions=1, repeats=4)
    smooth = runs_of_law(known_law(), rng)
    smooth = [replace(run, motion=f"smooth {run.motion}") for run in smooth]
    law = fit_joint_error([*jumping, *smooth], tails=False)
    fresh = [run for run in jumping_runs(rng, motions=2) if run.motion == "1"]

    def error(scored: JointErrorModel) -> float:
        rows = pd.DataFrame(commanded_rows(scored, fresh))
        return pooled(rows, ["horizon"])["measured_rad"]["0.5 s"]

    blind = replace(law, mean_gain=law.mean_gain * ~JUMP_INPUTS)
    assert error(law) < 0.5 * error(blind)


def test_a_command_between_the_rows_of_a_gap_in_the_clock_is_no_speed():
    (run,) = jumping_runs(default_rng(3), motions=1, repeats=1)
    ramp = np.clip(np.arange(60.0) - 10, 0, 20)
    command = ramp[:, None] * [2e-3, -1e-3]
    gap = command.copy()
    gap[30:] += 0.08  # in one sample, 8 rad/s
    for angles in (command, gap):
        speeds = lasting_speeds(replace(run, command=angles))
        np.testing.assert_allclose(np.abs(speeds).max(axis=0), [0.2, 0.1])
    # control: the difference quotient has the speed of the gap
    assert np.diff(gap, axis=0).max() * RATE > 7


@pytest.mark.parametrize("steps", [1, 10, 50])
def test_a_lag_that_is_not_known_widens_the_predictions_by_its_spread(steps):
    rng = default_rng(4)
    command = sweep(0)
    last = 250
    mean = np.array([5e-3, -8e-3])
    spread = 4e-3
    law = known_law(lag=mean, lag_std=np.full(2, spread))
    # squared errors
    of_mean_lag = []
    of_own_lag = []
    wide = narrow = None  # variances
    for run in runs_of_law(known_law(), rng, motions=1, repeats=60):
        lag = mean + spread * rng.standard_normal(2)
        delayed = delayed_angles(command, RATE * lag)
        about_sent = run.measured - run.command + delayed - command
        recorded = about_sent[:last]
        target = about_sent[last + steps - 1]

        predicted, wide = law.predict(recorded, command, steps)
        of_mean_lag.append((target - predicted) ** 2)
        predicted, narrow = law.predict(recorded, command, steps, lag=lag)
        of_own_lag.append((target - predicted) ** 2)

    nees = np.mean(of_mean_lag, axis=0) / np.diag(wide)
    assert np.all((0.5 < nees) & (nees < 1.8)), nees  # 60 draws: ± .55 at three errors
    assert np.all(np.mean(of_own_lag, axis=0) / np.diag(narrow) < 1.8)
    if steps == 50:  # control: the spread is needed
        assert np.any(np.mean(of_mean_lag, axis=0) / np.diag(narrow) > 2)


def test_without_known_errors_the_arm_starts_at_rest():
    law = known_law()
    rng = default_rng(6)
    command = sweep(1)[:80]
    draws = 3000
    mean, covariance = law.predict(np.empty((0, 2)), command, 80)
    std = np.sqrt(np.diag(covariance))

    q = np.tile(command[0], (draws, 1)) + law.mean_gain[:, 0]
    memory = law.first_memory(q, command[0], rng)
    for step in np.diff(command, axis=0, prepend=command[:1]):
        q, memory = law.follow(q, step, memory, rng)

    drawn = q - command[-1]
    off = np.abs(drawn.mean(axis=0) - mean)
    assert np.all(off < 5 * std / np.sqrt(draws))
    np.testing.assert_allclose(drawn.std(axis=0), std, rtol=0.08)


def test_the_lags_of_a_law_are_those_of_its_logs():
    runs = runs_of_law(known_law(), default_rng(1), motions=3, repeats=1)
    first = np.array([1e-3, 2e-3])
    second = np.array([3e-3, 2e-3])
    lags = (first, second, second)  # two runs of one log
    runs = [replace(run, lag=lag) for run, lag in zip(runs, lags, strict=True)]
    assert len(lags_of_logs(runs)) == 2
    law = fit_joint_error(runs, memory="none", power=0.0, tails=False)
    np.testing.assert_allclose(law.lag, [2e-3, 2e-3])
    # of a third log about the mean of two
    std_of_logs = 2e-3 / np.sqrt(2)
    np.testing.assert_allclose(law.lag_std, [std_of_logs * np.sqrt(1.5), 0.0])
    of_one_log = fit_joint_error(runs[:1], memory="none", power=0.0, tails=False)
    np.testing.assert_array_equal(of_one_log.lag_std, 0.0)


def test_a_constant_about_the_command_has_one_variance_at_all_horizons():
    runs = runs_of_law(known_law(), default_rng(1))
    law = fit_joint_error(runs, memory="none", power=0.0, tails=False)
    moving = np.concatenate([run.moving[1:] for run in runs])
    errors = np.concatenate([(run.measured - run.command)[1:] for run in runs])
    variance = np.mean(errors**2, axis=0, where=moving)
    for steps in (1, 50):
        mean, covariance = law.predict(errors[:100], sweep(0)[:150], steps)
        np.testing.assert_array_equal(mean, 0.0)
        np.testing.assert_allclose(np.diag(covariance), variance, rtol=0.02)


def test_runs_without_errors_are_refused():
    runs = runs_of_law(known_law(), default_rng(1), motions=1, repeats=1)
    still = [replace(run, measured=run.command) for run in runs]
    with pytest.raises(ModelDomainError, match="equal the commanded"):
        fit_joint_error(still)


def test_runs_shorter_than_the_longest_horizon_are_fitted_to_the_shorter_ones():
    runs = runs_of_law(known_law(), default_rng(1), motions=1, repeats=4)

    def cut(run: JointRun, count: int) -> JointRun:
        return replace(run, command=run.command[:count], measured=run.measured[:count])

    law = fit_joint_error([cut(run, 45) for run in runs])
    assert np.all(law.scale.sum(axis=1) > 0)
    # a fourth of the rows, held out, leaves none to fit
    with pytest.raises(ModelDomainError, match="too short to fit a law"):
        parts_of([cut(runs[0], 5)])


def test_a_trial_run_holds_out_the_first_motions_with_all_their_repetitions():
    runs = runs_of_law(known_law(), default_rng(1), motions=3, repeats=2)
    names = [run.motion for run in runs]
    chosen = [run.motion for run in of_first_motions(runs, 2)]
    assert chosen == [name for name in names if name != names[-1]] != names
    assert of_first_motions(runs, None) == runs
