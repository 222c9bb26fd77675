"""Values of a dataset's option file that its recordings and its URDF state, by dotted key."""

from __future__ import annotations

import os
from pathlib import Path

from pipeline.tools.inspect.finding import ROBOT, shown
from pipeline.tools.inspect.layout import Layout
from pipeline.tools.new_dataset.known_values import Values
from pipeline.tools.new_dataset.template import asked
from pipeline.tools.new_dataset.yaml_text import agreed, several, text_of

# sections of the option file that follow from an instrument of the datasheet are in the template


def option_values(name: str, recordings: str, layout: Layout, folder: Path) -> Values:
    """Return the values that the recordings of ``layout`` in ``folder``, which is ``recordings``
    from the project's root, and their URDF state.
    """
    takes = [take for group in (*layout.training, *layout.test) for take in group.takes.values()]
    logs = [log for group in layout.movements for log in group.takes.values()]
    rates = [None if one.rate is None else float(f"{one.rate:.4g}") for one in (*takes, *logs)]
    planar = bool(takes and not layout.bodies) or bool(layout.depth)
    robots = layout.single.get(ROBOT, [])
    facts = robots[0].facts if len(robots) == 1 else {}
    values = {"name": text_of(name), "motion.rate": agreed(rates)}
    values["motion.steps"] = agreed(take.facts.get("steps") for take in takes)
    if len(robots) == 1:
        values["robot.urdf"] = text_of(shown(Path(os.path.relpath(robots[0].file.resolve()))))
    if any(log.facts.get("settings", {}).get("rest") == "0" for log in logs):
        values["motion.pose_noise"] = asked()
    if layout.encoders:
        values["measurement"] = ""
    arms = facts.get("arms", [])
    if planar or (arms and [arms[0]["joints"]] == [c["joints"] for c in facts["chains"]]):
        return values | _chain(facts)
    if arms:
        tips = several([arm["tip"] for arm in arms])
        values["robot.joints"] = f"[{several(arms[0]['joints'])}] # all that move the last link"
        values["robot.tool"] = text_of(arms[0]["tip"]) if len(arms) == 1 else asked(f"of {tips}")
    return values


def _chain(facts: dict) -> Values:
    """The planar chain of the ``facts`` of a robot."""
    others, chains = facts.get("joints", {}).get("revolute", []), facts.get("chains", [])
    values = {"robot.plane": ""}
    if len(chains) == 1:
        joints, tools = chains[0]["joints"], chains[0]["tools"]
        others = [joint for joint in others if joint not in joints]
        values["robot.joints"] = f"[{several(joints)}] # the only three in a row that are parallel"
        values["robot.tool"] = (
            text_of(tools[0]) if len(tools) == 1 else asked(f"of {several(tools)}")
        )
    else:
        values["robot.joints"] = asked(f"three parallel ones of {several(others) or 'the URDF'}")
    values["robot.locked"] = asked(several(others)) if others or not chains else "{}"
    return values
