"""A laboratory whose motion takes a second, and a study of it that takes less."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.arm.model import load_arm
from pipeline.core import config
from pipeline.laboratory.options import (
    ClockOptions,
    DynamicsOptions,
    Robots,
    TrajectoryOptions,
    Transducer,
)
from pipeline.models.kinds import options_type
from pipeline.studies.survey.motion import MotionStudy
from pipeline.studies.survey.points import Study
from pipeline.studies.survey.robots import Laboratory, NoiseLaw
from pipeline.studies.survey.wrench import Configuration, ForceRig, WrenchStudy
from pipeline.verdicts.claims import Claim, parse_claims
from pipeline.wrench.bounds import Bounds

ROOT = Path(__file__).parents[3]
CLAIMS = (
    "reports/claims.yaml",
    "pipeline/studies/sensitivity/conclusions.yaml",
    "pipeline/studies/survey/conclusions.yaml",
)
ENDS = {"folded": (1.8544, -4.5335, 2.2406), "extended": (2.3867, -4.0012, 2.7773)}


@pytest.fixture(scope="session")
def claims() -> tuple[Claim, ...]:
    return tuple(
        claim for file in CLAIMS for claim in parse_claims(config.read_yaml(ROOT / file)["claims"])
    )


@pytest.fixture(scope="session")
def laboratory() -> Laboratory:
    joints = [f"arm_joint_{number}" for number in (2, 3, 4)]
    chain = load_arm(
        ROOT / "pipeline/arm/youbot.urdf",
        joints,
        "arm_tool",
        {"arm_joint_1": 2.967, "arm_joint_5": 2.923},
    ).chain
    law = NoiseLaw(
        np.array([0.0, 1.0]),
        np.array([[0.02, 0.0, 0.0], [0.0, 0.04, 0.0]]),
        np.array([1e-4, 4e-4])[:, None, None] * np.eye(3),
    )
    way = TrajectoryOptions(**ENDS, duration=1.6, rest=0.1, ramp=0.2)
    dynamics = DynamicsOptions(sway_std=[3e-4, 1.7e-3, 0.0332])  # a list, as an option file has it
    noise = np.array([[3.0, -2.0, 0.0], [-2.0, 7.0, -3.0], [0.0, -3.0, 6.0]]) * 1e-8
    joints = ("a", "b", "c")
    return Laboratory(chain, joints, dynamics, {"own": way}, ClockOptions(), noise, law, 2)


@pytest.fixture(scope="session")
def study(laboratory, claims) -> Study:
    models = {
        "additive": options_type("additive")("additive", estimator="paper"),
        "wishart": options_type("wishart")(
            "wishart", estimator="paper", decomposition="pivoted_lu", floor=0.2
        ),
        "gaussian": options_type("gaussian")("gaussian", estimator="paper", beta=0.5),
        "scaled_full": options_type("scaled")("scaled", structure="full"),
    }
    bounds = Bounds((3.0, 5.0), (0.8, 3.1), (0.5, 1.0), (100.0, 800.0))
    motion = MotionStudy(laboratory, models, "systematic", 0.5, "one_step", 12, 4, 12)
    pulled = Configuration(bounds, [3.0, 4.0, 5.0], [0.8, 1.5, 2.2], [0.5, 0.6, 0.7])
    rig = ForceRig(Robots((0.5, 0.6, 0.7), (200.0, 300.0, 400.0)), Transducer(), 1.0, 20.0)
    return Study(motion, WrenchStudy(bounds, {"C1": pulled}, rig, 20, 20, 2), claims)
