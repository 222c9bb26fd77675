"""The bootstrap filter of `particles` on the take."""

import numpy as np
import particles
from particles.collectors import Moments
from takes import Take, take_of

CONFIGURATION = (
    "the law of a step in NumPy, all particles at once; `particles.SMC` with systematic "
    "resampling, compiled by Numba, below half of the effective sample size; moments alone "
    "are collected, no history kept"
)


class Motion(particles.FeynmanKac):
    """Moved by the model, weighted by the frames."""

    def __init__(self, take: Take) -> None:
        super().__init__(T=len(take.steps) + 1)
        self.take = take

    def M0(self, N):
        return self.take.start(N)

    def M(self, t, xp):
        return self.take.step(t, xp)

    def logG(self, t, xp, x):
        return self.take.log_likelihood(t, x) if t in self.take.y else np.zeros(len(x))


def setup(count, **plain):
    motion = Motion(take_of(**plain))

    def call() -> list:
        filtered = particles.SMC(
            motion,
            N=count,
            resampling="systematic",
            ESSrmin=0.5,
            collect=[Moments()],
        )
        filtered.run()
        return [moments["mean"].tolist() for moments in filtered.summaries.moments]

    return call
