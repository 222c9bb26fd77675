"""The LWR4+'s URDF against the Denavit-Hartenberg values it was made from, and against another
description of the same arm.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

ROOT = Path(__file__).parents[2]
URDF = ROOT / "pipeline/arm/lwr4.urdf"
OTHER = ROOT.parent / "shared/recordings/lwr4/kuka_lwr4.urdf"
D = (0.31, 0.0, 0.4, 0.0, 0.39, 0.0, 0.078)  # m
TWIST = np.deg2rad((90, -90, -90, 90, 90, -90, 0))
POSES = np.random.default_rng(5).uniform(-2, 2, (20, 7))


def dh(q: np.ndarray) -> np.ndarray:
    """The flange after Denavit and Hartenberg, standard convention, in the base frame."""
    frame = np.eye(4)
    for angle, d, twist in zip(q, D, TWIST, strict=True):
        c, s, ct, st = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        frame = frame @ np.array(
            [[c, -s * ct, s * st, 0], [s, c * ct, -c * st, 0], [0, st, ct, d], [0, 0, 0, 1]]
        )
    return frame


def placement(model: pin.Model, q: np.ndarray, frame: str) -> pin.SE3:
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return pin.updateFramePlacement(model, data, model.getFrameId(frame)).copy()


def test_the_flange_is_where_the_listed_values_put_it():
    model = pin.buildModelFromUrdf(str(URDF))
    assert model.nq == 7
    for q in POSES:
        at = placement(model, q, "flange").homogeneous
        np.testing.assert_allclose(at, dh(q), atol=1e-12)


def test_another_description_of_the_arm_agrees_but_for_half_a_millimetre_of_its_height():
    if not OTHER.is_file():
        pytest.skip(f"there is no other description at {OTHER}")
    model, other = pin.buildModelFromUrdf(str(URDF)), pin.buildModelFromUrdf(str(OTHER))
    for name in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit"):
        ours, theirs = (getattr(m, name) for m in (model, other))
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
    for q in POSES:
        base = placement(other, q, "lwr_base_link")
        theirs = base.inverse() * placement(other, q, "lwr_7_link")
        # its frame of the last link lies at the flange; its second joint is at 0.3105 m
        ours = placement(model, q, "flange")
        np.testing.assert_allclose(ours.rotation, theirs.rotation, atol=1e-6)
        difference = theirs.translation - ours.translation
        np.testing.assert_allclose(difference, [0, 0, 5e-4], atol=1e-6)
