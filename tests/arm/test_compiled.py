"""The chain's closed forms in scalars."""

from __future__ import annotations

import numpy as np
from compiled_calls import from_python

from pipeline.arm.chain import PlanarChain
from pipeline.arm.compiled import joint_step, plane_of, turned


def test_turned_links_and_joint_steps_are_the_chains():
    links = np.array([[0.01, 0.155], [-0.02, 0.135], [0.03, 0.17]])
    ends = np.full(3, -3.0), np.full(3, 3.0), np.ones(3)
    chain = PlanarChain(np.zeros(2), links, np.array([1.0, -1.0, 1.0]), *ends)
    q = np.random.default_rng(0).uniform(-2, 2, (2000, 3))
    poses = q[np.abs(chain.determinant(q)) > 0.2 * chain.lengths[0] * chain.lengths[1]]
    v = np.array([0.004, -0.003, 0.03])
    arm = from_python(plane_of)(chain.numbers())
    turn, moved = from_python(turned), from_python(joint_step)
    headings = chain.headings(poses)
    segments = [
        [turn(link, heading) for link, heading in zip(arm.links, each, strict=True)]
        for each in headings
    ]
    np.testing.assert_allclose(segments, np.diff(chain.points(poses), axis=1), atol=1e-15)
    rows = (chain.jacobian(poses) * chain.signs)[:, :2]
    steps = [moved(arm, tuple(x), tuple(z), tuple(v)) for x, z in rows]
    np.testing.assert_allclose(
        steps, np.matvec(chain.inverse_jacobian(poses), v), rtol=1e-12, atol=1e-15
    )
