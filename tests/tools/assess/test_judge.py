"""Takes of one kind are called another as seldom as is said; a push is found, in its joint and at
its time.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.tools.assess.judge import LEVEL, Verdict, judge
from pipeline.tools.assess.moment_filter import Innovations
from pipeline.tools.assess.words import said

TAKES, STEPS, JOINTS = 50, 100, ["a", "b", "c"]


def innovations(seed: int, takes: int = TAKES + 1) -> Innovations:
    """Of heavy-tailed steps, whose scale differs from take to take, and which are predicted normal;
    the evidence is then far from normal.
    """
    rng = np.random.default_rng(seed)
    scale = rng.gamma(4, 1 / 4, (takes, 1, 1))
    error = scale * rng.standard_t(4, (takes, STEPS, 3))
    return Innovations(error, np.broadcast_to(np.eye(3), (takes, STEPS, 3, 3)))


def verdict(drawn: Innovations) -> Verdict:
    """On the last of the takes, held against all before it."""
    others = np.arange(len(drawn.error)) < len(drawn.error) - 1
    return judge(drawn, len(drawn.error) - 1, others, JOINTS, 100.0)


def test_a_take_of_the_same_kind_is_called_another_as_seldom_as_the_level_says():
    called = [not verdict(innovations(seed)).behaves for seed in range(150)]
    # at most LEVEL: 7.5 of 150 on average, and not beyond five standard deviations of that
    assert 0 < sum(called) < 7.5 + 5 * np.sqrt(7.5)
    assert verdict(innovations(0)).limit == LEVEL / 2
    assert verdict(innovations(0, takes=5)).limit == 1 / 5


@pytest.mark.parametrize(("joint", "first"), [(1, 0), (2, 60)])
def test_a_push_is_found_in_its_joint_and_span(joint, first):
    drawn = innovations(3)
    assert verdict(drawn).behaves
    drawn.error[-1, first : first + 8, joint] += 12.0
    pushed = verdict(drawn)
    assert not pushed.behaves and pushed.p_spans <= pushed.limit
    text = said("new", "model.json", 0, pushed)
    assert "new does NOT behave as the 50 takes it is compared with (model.json)." in text
    begins = f"{JOINTS[joint]} from {first / 100:.3g} to {(first + 10) / 100:.3g} s, less likely"
    assert f"largest difference: {begins}" in text


def test_a_take_that_is_wider_throughout_is_told_as_a_whole_and_one_that_rests_as_more_likely():
    drawn = innovations(3)
    drawn.error[-1] *= 6
    assert verdict(drawn).p_whole <= verdict(drawn).limit
    drawn.error[-1] = 0.0
    assert (verdict(drawn).span_t > 0).all()


def test_with_three_takes_to_compare_with_no_difference_can_be_shown():
    text = said("new", "model.json", 3, verdict(innovations(3, takes=4)))
    assert (
        "no difference of new can be shown with 3 takes to compare with: record 7 or more" in text
    )
    assert "behave" not in text.splitlines()[0]
    assert "can be shown" not in said("new", "model.json", 0, verdict(innovations(3, takes=8)))
