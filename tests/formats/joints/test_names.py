"""What labels say of signals, and what they leave open."""

from __future__ import annotations

import pytest

from pipeline.formats.joints.names import signals_of


@pytest.mark.parametrize(
    ("labels", "signals"),
    [
        (
            ["t", "q_1", "q_0", "qd_0", "qd_1"],
            {"actual": ["q_0", "q_1"], "target": ["qd_0", "qd_1"]},
        ),
        (
            ["actual_base", "actual_tip", "target_base", "target_tip"],
            {"actual": ["actual_base", "actual_tip"], "target": ["target_base", "target_tip"]},
        ),
        (["q[0] (rad)", "q[1] (rad)"], {"actual": ["q[0] (rad)", "q[1] (rad)"]}),
        (["q_0", "measured_0", "target_0"], {"target": ["target_0"]}),  # two could be measured
        (["time", "fx", "fy", "j1", "j2"], {}),
    ],
)
def test_labels_say_which_columns_are_a_signal(labels, signals):
    assert signals_of(labels) == signals
