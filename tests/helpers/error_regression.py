"""Reference for predicted joint errors: a linear regression for every horizon, written without the
joint error law.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy import stats

from pipeline.models.joint_error.held_out import parts_of
from pipeline.models.joint_error.samples import JointRun

RIDGE = 1e-9  # relative, for a joint that is never commanded to move


def samples_of_joint(
    run: JointRun,
    j: int,
    steps: int,
) -> tuple[ndarray, ndarray]:
    """Return inputs (K, 9) and errors (K,) in rad of joint ``j`` at the samples to which it is
    commanded to move: the inputs are a constant, the errors ``steps`` and ``steps`` + 1 samples
    before, and speed, acceleration and sign of the command then and now.
    """
    command = run.command[:, j]
    error = run.measured[:, j] - run.command[:, j]
    speed = run.rate * np.diff(command, prepend=command[0])
    acceleration = run.rate * np.diff(speed, prepend=speed[0])
    drive = np.stack([speed, acceleration, np.sign(speed)], axis=-1)
    now = np.arange(steps + 1, len(command))
    now = now[run.moving[now, j]]
    before = now - steps
    past = np.stack([np.ones(len(now)), error[before], error[before - 1]], axis=-1)
    return np.concatenate([past, drive[before], drive[now]], axis=-1), error[now]


@dataclass(frozen=True)
class Regression:
    """Linear mean with normal errors, or errors of Student's t, of one joint and horizon."""

    gains: ndarray  # (9,)
    law: stats.rv_continuous

    @classmethod
    def of_samples(cls, inputs: ndarray, error: ndarray) -> "Regression":
        """Fit mean and law; the law is the likelier of the normal one and Student's t."""
        moment = inputs.T @ inputs
        moment += np.diag(RIDGE * np.diag(moment) + 1e-30)
        gains = np.linalg.solve(moment, inputs.T @ error)
        residuals = error - inputs @ gains
        std = residuals.std() + 1e-12
        # the median of |t| over its scale is .74 for 4 degrees of freedom
        start = np.median(np.abs(residuals)) / 0.74 + 1e-12
        degrees, _, scale = stats.t.fit(residuals / start, 4.0, floc=0.0, scale=1.0)
        laws = [stats.norm(0.0, std), stats.t(degrees, 0.0, start * scale)]
        likelihoods = [law.logpdf(residuals).sum() for law in laws]
        return cls(gains, laws[int(np.argmax(likelihoods))])

    def scores(self, inputs: ndarray, error: ndarray, quantum: float) -> ndarray:
        """(K,) log probability in nats of the cell of each recorded error over its width."""
        off = error - inputs @ self.gains
        density = self.law.logpdf(off)
        if quantum == 0:
            return density
        upper = self.law.sf(np.abs(off) - quantum / 2)
        cell = upper - self.law.sf(np.abs(off) + quantum / 2)
        log_cell = np.log(np.maximum(cell, 1e-300) / quantum)
        return np.where(cell > 1e-280, log_cell, density)


def regression_score(runs: Sequence[JointRun], steps: int) -> float:
    """Return the mean log score in nats of the regressions for ``steps`` samples, summed over the
    joints that move, on the held-out parts of the ``runs``.
    """
    total = 0.0
    for j in range(len(runs[0].joints)):
        scores = []
        for part in parts_of(runs).values():
            fitted = [samples_of_joint(run, j, steps) for run in part.fitted]
            inputs, error = map(np.concatenate, zip(*fitted, strict=True))
            scored = [samples_of_joint(run, j, steps) for run in part.scored]
            for_score, error_for_score = map(np.concatenate, zip(*scored, strict=True))
            if not len(error) or not len(error_for_score):
                continue
            regression = Regression.of_samples(inputs, error)
            quantum = part.scored[0].quantum[j]
            scores.append(regression.scores(for_score, error_for_score, quantum))
        if scores:
            total += float(np.concatenate(scores).mean())
    return total
