"""Control recordings, whose law is known: the recorded motion with its noise drawn anew from a stated model, and a robot at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline import schema
from pipeline.motion.estimation import Recorded
from pipeline.motion.model import MotionModel

# the consistent estimator of each of the paper's models
CONSISTENT = {schema.Additive: "shrinkage", schema.Wishart: "likelihood", schema.Gaussian: "likelihood"}


def drawn(truth: MotionModel, recorded: Recorded, rng: np.random.Generator) -> Recorded:
    """``recorded`` with the noise ω of every step drawn from ``truth`` at the recorded pose, plus N(0, Σ_m), Σ_m that of the recordings.

    So the law of a step given the measured pose before it is exactly the one that the likelihoods assume, and Σ_m is known: where the
    robot rests additive noise cannot be told from it. Raises SingularJacobianError and, where the motion never rests, ModelDomainError.
    """
    q, v = recorded.q, np.broadcast_to(recorded.v, recorded.q.shape)
    nominal = q + np.matvec(recorded.chain.inverse_jacobian(q), v)
    step, _ = truth.sample(recorded.chain, q, v, rng)
    noise = step - nominal + rng.multivariate_normal(np.zeros(3), recorded.measurement, q.shape[:-1])
    return replace(recorded, noise=noise, known_measurement=recorded.measurement)


def at_rest(recorded: Recorded, rng: np.random.Generator) -> Recorded:
    """A robot that holds the recorded poses: no command, and of the noise ω only the measurement's, N(0, Σ_m)."""
    noise = rng.multivariate_normal(np.zeros(3), recorded.measurement, recorded.q.shape[:-1])
    return Recorded(recorded.chain, recorded.q, np.zeros_like(recorded.v), noise, recorded.measurement)


def consistent(options: schema.Model) -> schema.Model:
    """The options of the same model with its consistent estimator; of a baseline, which has no other, the same."""
    return replace(options, estimator=CONSISTENT[type(options)]) if type(options) in CONSISTENT else options
