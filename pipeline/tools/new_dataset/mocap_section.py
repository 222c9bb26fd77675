"""Sections ``mocap`` and ``encoders`` of a new dataset's datasheet."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.tools.inspect.joints import MEASURED
from pipeline.tools.inspect.layout import Group, Layout, links_of
from pipeline.tools.new_dataset.yaml_text import OPEN, one_of, several, text_of


def mocap_section(layout: Layout) -> list[str]:
    """The lines of ``mocap``."""
    takes = [take for group in (*layout.training, *layout.test) for take in group.takes.values()]
    lines = ["mocap:"]
    lines += _parts(layout.training, layout.test)
    if any(take.units.get("length") == "not stated" for take in takes):
        lines.append(f"  unit: {OPEN} # m, cm or mm: the files do not say it")
    lines += [
        "  base: # the arm's base in the motion capture's world",
        f"    position: {OPEN} # m, [x, y, z], of the base frame of the URDF: by markers on the "
        "base, or a probe at its bolts",
        f"    rpy: {OPEN} # rad, about the fixed axes x, y, z, likewise; Motive's world has y "
        "up: [-1.5707963267948966, 0.0, 0.0] turns it",
    ]
    if layout.bodies:
        return lines + _bodies(layout.bodies)
    shared = layout.markers
    if links := links_of(shared):
        lines.append(
            "  markers: # m, from the joint at each segment's start (z along it, y the normal of "
            "the plane), by callipers; grouped by name"
        )
        for link, names in links.items():
            lines += [
                f"    {text_of(link)}:",
                *(f"      {text_of(name)}: {OPEN} # [x, y, z]" for name in names),
            ]
    else:
        names = ", ".join(map(text_of, shared)) or "none in all takes"
        lines.append(
            f"  markers: {OPEN} # three links of three markers, "
            f"{{link1: {{name: [x, y, z], …}}, …}} in m; there are {names}"
        )
    return lines


def encoders_section(layout: Layout) -> list[str]:
    """The lines of ``encoders``: joint logs that are named as takes of the motion capture."""
    takes = {name for group in layout.training for name in group.named}
    training = [group for group in layout.encoders if takes & {*group.named}]
    test = [group for group in layout.encoders if not takes & {*group.named}]
    facts = next(iter(layout.encoders[0].takes.values())).facts
    labels = [str(label) for label in facts.get("labels", [])]
    measured = [label for label in labels if any(word in label.lower() for word in MEASURED)]
    time = labels[0] if labels and facts.get("increasing_columns", [])[:1] == [0] else None
    columns = f"[{several(measured)}]" if measured else OPEN
    known = f": of {several(labels)}" if labels and not measured else ", by label or number"
    return [
        "encoders: # the controller's logs beside the motion capture: `measurement: encoders` in "
        "the option file weighs by them",
        *[
            line if line != "  test: null" else f"  test: {OPEN} # pattern of the test takes' logs"
            for line in _parts(training, test)
        ],
        f"  time: {text_of(time) if time else 0} # column",
        f"  actual: {columns} # column of the measured angles of each of robot.joints{known}",
        f"  angle_unit: {OPEN} # rad or deg",
        f"  time_unit: {OPEN} # s, ms, us or ns",
        f"  start: {OPEN} # s on the logs' clock when the motion capture starts",
    ]


def _parts(training: Sequence[Group], test: Sequence[Group]) -> list[str]:
    """Which group is which is known where the depth camera saw the one; a single group is what
    there is to fit to.
    """
    if len(training) == 1 and len(test) <= 1:
        return [
            f"  training: {text_of(training[0].pattern)}",
            f"  test: {text_of(test[0].pattern) if test else 'null'}",
        ]
    patterns = [text_of(group.pattern) for group in (*training, *test)]
    return [
        f"  training: {one_of(patterns)} # takes that the models are fitted to",
        f"  test: {OPEN} # that they are compared on",
    ]


def _bodies(names: Sequence[str]) -> list[str]:
    """Links that are followed by rigid bodies of these ``names``."""
    lines = [
        "  # the keys below are bodies: put for each the link of the URDF that it is fixed to, in "
        "markers and in bodies; delete the others",
        "  markers: # of each link three places or more that its body carries, as its markers, in "
        "m in the link's frame",
    ]
    lines += [f"    {text_of(name)}: {OPEN} # {{a: [x, y, z], b: …, c: …}}" for name in names]
    lines.append("  bodies: # where the pivot of each is mounted in the link's frame: m, and rad")
    for name in names:
        lines += [
            f"    {text_of(name)}:",
            f"      name: {text_of(name)}",
            "      mount:",
            f"        position: {OPEN} # [x, y, z]",
            f"        rpy: {OPEN} # likewise",
        ]
    lines.append(
        "  # posture: [a, b, …] # rad, about where every take starts; where the bodies fit several "
        "postures of the joints"
    )
    return lines
