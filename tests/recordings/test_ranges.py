"""The ranges of a fit are those of its poses, joint speeds and commands."""

from __future__ import annotations

import numpy as np
from planar_poses import chain  # noqa: F401 - a fixture

from pipeline.models.steps import Recorded
from pipeline.recordings.steps import fitted_ranges


def test_every_quantity_has_the_ends_of_its_values(chain):  # noqa: F811
    q = np.array([[[0.1, 1.2, 0.3], [0.2, 1.6, 0.3]], [[0.0, 1.4, 0.5], [0.2, 1.5, 0.4]]])
    v = np.array([[0.001, 0.0, 0.01], [-0.002, 0.0, 0.02]])
    recorded = Recorded(chain, q, v, np.zeros_like(q), ("a", "b", "c"))
    rows = fitted_ranges(recorded, 100.0).set_index(["quantity", "name"])
    assert rows.loc[("speed", "x"), ["least", "greatest", "unit"]].tolist() == [-0.2, 0.1, "m/s"]
    # the pose after the last step counts, as it was measured too
    last = q[:, -1] + np.matvec(np.linalg.inv(chain.jacobian(q[:, -1])), v[-1])
    both = np.concatenate([q.reshape(-1, 3), last])
    assert rows.loc[("pose", "b"), "greatest"] == both[:, 1].max()
    assert rows.loc[("pose", "b"), "least"] == both[:, 1].min()
    norms = np.linalg.norm(np.linalg.inv(chain.jacobian(q)), axis=(-2, -1))
    np.testing.assert_allclose(rows.loc[("condition", "‖J⁺‖"), "greatest"], norms.max())
