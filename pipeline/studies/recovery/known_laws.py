"""Recordings of a known law: the recorded motion with its noise drawn anew from a stated model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.models.draws import draw_steps
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded


def drawn(truth: MotionModel, recorded: Recorded, rng: np.random.Generator) -> Recorded:
    """Return ``recorded`` with the noise ω of every step drawn from ``truth`` at the recorded pose,
    plus N(0, Σ_m), Σ_m that of the recordings.

    So the law of a step given the measured pose before it is exactly the one that the likelihoods
    assume, and Σ_m is known: where the robot rests, additive noise equals it. Raises
    SingularJacobianError and, where the motion never rests, ModelDomainError.
    """
    q, v = recorded.q, recorded.v
    nominal = q + recorded.chain.nominal_step(q, v)
    step, _ = draw_steps(truth, recorded.chain, q, v, rng)
    measured = rng.multivariate_normal(np.zeros(q.shape[-1]), recorded.measurement, q.shape[:-1])
    noise = step - nominal + measured
    return replace(recorded, noise=noise, known_measurement=recorded.measurement)
