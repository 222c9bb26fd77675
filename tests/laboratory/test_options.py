"""Options of the laboratory that describe nothing, refused with the key of their fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.laboratory.force import Cables, record_force
from pipeline.laboratory.options import (
    ClockOptions,
    DynamicsOptions,
    EncoderOptions,
    KinectOptions,
    MocapOptions,
    Robots,
    TrajectoryOptions,
    Transducer,
)
from pipeline.laboratory.session import open_session

MOTION = TrajectoryOptions(folded=(0.0, 0.0), extended=(0.5, 0.5))
ROBOTS = Robots((1.0,), (100.0,))
REFUSALS = [  # options, a change that makes no sense, the key of the fault
    (MOTION, {"folded": (0.0,)}, "extended"),
    (MOTION, {"rest": 0.6}, "duration"),
    (MOTION, {"ramp": 0.0}, "ramp"),
    (DynamicsOptions(), {"sway_std": (1e-3, -1e-3, 0.0)}, "sway_std.1"),
    (DynamicsOptions(), {"servo_gain": 1000.0}, "servo_gain"),
    (EncoderOptions(), {"resolution": 0.0}, "resolution"),
    (ClockOptions(), {"drift": -1.0}, "drift"),
    (MocapOptions(), {"swap_rate": 1.5}, "swap_rate"),
    (MocapOptions(), {"occlusion_frames": 0.5}, "occlusion_frames"),
    (KinectOptions(), {"range": (4.5, 0.5)}, "range"),
    (KinectOptions(), {"edge_lost": 0.9, "edge_mixed": 0.2}, "edge_mixed"),
    (KinectOptions(), {"grazing_limit": 1.6}, "grazing_limit"),
    (ROBOTS, {"concentration": (100.0, 100.0)}, "concentration"),
    (Transducer(), {"rate": 0.0}, "rate"),
]


@pytest.mark.parametrize(("options", "change", "key"), REFUSALS)
def test_options_without_a_meaning_are_refused_by_their_key(options, change, key):
    with pytest.raises(ConfigError) as refused:
        replace(options, **change)
    assert refused.value.evidence["key"] == key


@pytest.mark.parametrize(
    ("change", "key"), [({"sway_std": (1e-3, 1e-3)}, "sway_std"), ({"play_joint": 4}, "play_joint")]
)
def test_the_disturbances_of_another_arm_are_refused(arm, dynamics, rng, change, key):
    with pytest.raises(ConfigError, match=rf"laboratory\.dynamics\.{key}"):
        open_session(arm.chain, replace(dynamics, **change), rng)


@pytest.mark.parametrize(("tension", "tare"), [((9.0, 9.0), 1.0), ((9.0,), -1.0)])
def test_a_force_record_that_cannot_be_made_is_refused(tension, tare):
    with pytest.raises(ConfigError, match=r"laboratory\.force"):
        cables, rng = Cables(tension, (0.1,)), np.random.default_rng(38)
        record_force(cables, ROBOTS, Transducer(), tare, 1.0, rng)
