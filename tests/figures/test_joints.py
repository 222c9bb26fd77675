"""An arm of any number of joints has a panel for each, under its own name, that can be read."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from pipeline.figures import filter_errors, joint_realizations, joint_std
from pipeline.figures.style import joint_lines, joint_panels

MODELS = ["additive", "wishart", "gaussian"]
STEPS = 20
ARMS = {
    "one": ["slide"],
    "six": ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"],
    "seven": [f"lwr_a{number}" for number in range(7)],
    "eight": [f"axis_{number}" for number in range(2, 10)],
}
LEAST = 1.1, 0.7  # in, a panel that can be read


def table(joints: list[str], families: str, **known: str) -> pd.DataFrame:
    """Of each family a column a joint: a line at the height of the joint's place in the arm, in
    each take a little another.
    """
    wave = 0.1 if known.get("take") == "b" else 0.2
    rows = pd.DataFrame({"k": np.arange(STEPS + 1), "t": np.arange(STEPS + 1) / 100} | known)
    for family in families:
        for place, joint in enumerate(joints, 1):
            rows[f"{family}:{joint}"] = place + wave * np.sin(rows["k"])
    return rows


def std(joints: list[str]) -> Figure:
    rows = [table(joints, "s", source=source) for source in ("recorded", *MODELS)]
    return joint_std.draw(pd.concat(rows), MODELS, joints, "one_step")


def errors(joints: list[str]) -> Figure:
    known = [(m, take) for m in ("none", *MODELS) for take in ("test_1", "test_2")]
    rows = [table(joints, "es", model=model, take=take) for model, take in known]
    return filter_errors.draw(pd.concat(rows), MODELS, joints)


def realizations(joints: list[str]) -> Figure:
    parts = [table(joints, family, take=t, part="training") for t in "ab" for family in "qw"]
    return joint_realizations.draw(pd.concat(parts[::2]), pd.concat(parts[1::2]))


def shown(figure: Figure) -> list[str]:
    """The joint that each panel says it shows."""
    names = [axes.get_title() or axes.get_ylabel() for axes in figure.axes]
    return [name.removesuffix(" (rad)") for name in names if not name.startswith("std of its")]


def readable(figure: Figure) -> bool:
    """Whether every panel is large enough and none with its letters touches another."""
    figure.draw_without_rendering()
    sizes = [axes.get_window_extent().size / figure.dpi for axes in figure.axes]
    boxes = {axes.get_position().bounds: axes for axes in figure.axes}
    letters = [axes.get_tightbbox() for axes in boxes.values()]
    apart = not any(one.overlaps(other) for one, other in combinations(letters, 2))
    return bool(np.all(np.array(sizes) >= LEAST)) and apart


@pytest.mark.slow
@pytest.mark.parametrize("joints", ARMS.values(), ids=ARMS)
def test_every_joint_has_a_panel_of_its_own_numbers_under_its_own_name(joints):
    names = [line["label"] for line in joint_lines(joints).values()]
    lines = len({axes.get_position().y0 for axes in std(joints).axes})
    for figure, groups in ((std(joints), 1), (errors(joints), 3), (realizations(joints), 1)):
        assert shown(figure)[: len(joints)] == names
        panes = figure.axes[: groups * len(joints)]
        heights = [axes.lines[0].get_ydata().mean() for axes in panes]
        assert np.round(heights).tolist() == [*range(1, len(joints) + 1)] * groups
    # with two lines a model, what is above a panel is another joint
    assert shown(errors(joints)).count(names[-1]) == (3 if lines == 2 else 1)


@pytest.mark.slow
@pytest.mark.parametrize("joints", ARMS.values(), ids=ARMS)
@pytest.mark.parametrize("draw", [std, errors, realizations])
def test_every_panel_can_be_read_and_has_its_time_below_or_above_one_that_has(draw, joints):
    figure = draw(joints)
    assert readable(figure)
    below = [axes for axes in figure.axes if axes.get_xlabel() == "time (s)"]
    columns = {round(axes.get_position().x0, 6) for axes in figure.axes}
    assert {round(axes.get_position().x0, 6) for axes in below} == columns
    for axes in below:
        here = [other for other in figure.axes if other.get_position().x0 == axes.get_position().x0]
        assert axes.get_position().y0 == min(other.get_position().y0 for other in here)
        assert any(label.get_visible() for label in axes.get_xticklabels())


@pytest.mark.slow
def test_eight_panels_in_one_line_could_not_be_read():
    figure, _ = joint_panels(8, 8, (7.16, 1.9, 0.6))
    assert not readable(figure)
    assert readable(joint_panels(8, 4, (7.16, 1.9, 0.6))[0])


def test_eight_joints_are_told_apart_in_one_panel():
    looks = [(line["color"], line["linestyle"]) for line in joint_lines(ARMS["eight"]).values()]
    assert len(set(looks)) == 8
