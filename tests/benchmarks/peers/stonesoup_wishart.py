"""The particle predictor and updater of `stonesoup` on the take."""

from datetime import datetime, timedelta

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import ESSResampler
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import ParticleState, StateVectors
from stonesoup.updater.particle import ParticleUpdater
from takes import Take, take_of

START = datetime(2017, 1, 1)
STEP = timedelta(milliseconds=10)
CONFIGURATION = (
    "the law of a step in NumPy, all particles at once; `ParticlePredictor`, "
    "`ParticleUpdater` and `ESSResampler`, systematic below half of the effective sample size"
)


class Motion(TransitionModel):
    """Moved by the model: a state vector is (n, P)."""

    take: Take = Property()
    rvs = pdf = ndim_state = None  # abstract there, not used by a particle filter

    def function(self, state, noise=False, time_interval=None, **kwargs):
        k = round((state.timestamp + time_interval - START) / STEP)
        return StateVectors(
            self.take.step(k, np.asarray(state.state_vector, dtype=float).T).T,
        )


class Sensor(MeasurementModel):
    """Weighted by the frames."""

    take: Take = Property()
    rvs = pdf = ndim_meas = None

    def function(self, state, noise=False, **kwargs):
        return state.state_vector

    def logpdf(self, state1, state2, **kwargs):
        q = np.asarray(state2.state_vector, dtype=float).T
        return self.take.log_likelihood(round((state1.timestamp - START) / STEP), q)


def setup(count, **plain):
    take = take_of(**plain)
    predictor = ParticlePredictor(Motion(take))
    joints = len(take.start_mean)
    # the estimate is formed before resampling, as everywhere else
    sensor = Sensor(ndim_state=joints, mapping=tuple(range(joints)), take=take)
    updater = ParticleUpdater(sensor)
    resampler = ESSResampler()

    def call() -> list:
        particles = StateVectors(take.start(count).T)
        weight = np.full(count, 1 / count)
        state = ParticleState(particles, weight=weight, timestamp=START)
        means = [np.ravel(state.mean).tolist()]
        for k in range(1, len(take.steps) + 1):
            state = predictor.predict(state, timestamp=START + k * STEP)
            if k in take.y:
                seen = Detection(take.y[k][:, None], timestamp=START + k * STEP)
                state = updater.update(SingleHypothesis(state, seen))
            means.append(np.ravel(state.mean).astype(float).tolist())
            state.covar  # noqa: B018 - computed when asked for
            state = resampler.resample(state)
        return means

    return call
