"""Option file of a new dataset: what the analysis does with its recordings."""

from __future__ import annotations

from pathlib import Path

from pipeline.tools.inspect.finding import ROBOT, Finding, shown
from pipeline.tools.inspect.layout import Layout
from pipeline.tools.new_dataset.yaml_text import OPEN, agreed, several, text_of


def option_file(name: str, recordings: str, layout: Layout, folder: Path) -> str:
    """The text of pipeline/conf/dataset/NAME.yaml for the recordings of ``layout`` in ``folder``,
    which is ``recordings`` from the project's root.
    """
    takes = [take for group in (*layout.training, *layout.test) for take in group.takes.values()]
    logs = [log for group in layout.movements for log in group.takes.values()]
    rates = [meant(take.rate) for take in (*takes, *logs)]
    passing = any(log.facts.get("settings", {}).get("rest") == "0" for log in logs)
    planar = bool(takes and not layout.bodies) or bool(layout.depth)
    robots = layout.single.get(ROBOT, [])
    urdf = (
        text_of(f"{recordings}/{shown(robots[0].file.relative_to(folder))}")
        if len(robots) == 1
        else OPEN
    )
    lines = [
        f"# {name}: what the analysis does with the recordings that data/raw/{name}/dataset.yaml "
        "describes. Put a value for every ???.",
        f"name: {text_of(name)}",
        "robot:",
        f"  urdf: {urdf} # from the project's root; those of the youBot, the UR5 and the LWR4+ are "
        "in pipeline/arm",
        *_arm(robots, planar=planar),
        "motion:",
        f"  rate: {agreed(rates)} # 1/s, of the motion grid",
        f"  steps: {agreed(take.facts.get('steps') for take in takes)} # M, steps of a take",
    ]
    if passing:
        lines.append(
            f"  pose_noise: {OPEN} # rad, standard deviation of a measured joint angle, which no "
            "row at rest shows",
        )
    if takes:
        lines += [
            "mocap:",
            "  gate: 0.012 # m, how far a marker may be from where it is predicted to be taken "
            "for it: under half of what parts two",
            "  max_gap: 20 # frames, longest gap that is interpolated",
        ]
    if layout.encoders:
        lines.append("measurement: encoders # what the filter weighs particles by; or tip, depth")
    if layout.depth:
        lines += [
            "depth:",
            "  search: 0.5 # s, the clocks' offset is looked for between -search and +search",
            "  workspace: # what of the scene is the arm, in the frame of its plane; these are a "
            "youBot's: measure yours with a ruler",
            "    half_depth: 0.06 # m, half of the arm's thickness across its plane, and the "
            "sensor's noise",
            "    girth: 0.05 # m, how far the arm's surface is from the lines between its joints",
            "    column_half_width: 0.06 # m, half of the width of what carries the first joint "
            "of the chain, along the plane",
            "    column_top: -0.015 # m, its upper end above that joint (negative: below)",
            "    floor: 0.0 # m, height of what the arm stands on, in its base frame",
            "    min_pixels: 30 # fewer are no arm",
            "    max_points: 1500 # of a frame that are kept",
        ]
    if layout.force:
        lines += [
            "force: # [least, greatest] that are given for the models: what your robots and "
            "their identification allow",
            f"  kappa_bounds: {OPEN} # 1, of the concentration of the directions (the paper: "
            "[169.35, 2416.0])",
            f"  tension_std_bounds: {OPEN} # N, of the spread of a robot's tension (the paper: "
            "[0.48, 2.27])",
            f"  tension_bounds: {OPEN} # N, of the mean tensions (the paper: [1.82, 13.89])",
        ]
    if layout.movements:
        lines += [
            "joint_log:",
            f"  start: {OPEN} # rad, [a, b, …]: commanded angles of robot.joints at rest before "
            "the motion, as in the log of the commands",
            f"  end: {OPEN} # rad, [a, b, …]: and after it",
            f"  rest: {OPEN} # steps at rest kept on either side, of motion.steps: at most half "
            "of the shortest pause between two motions; 0 where the command never rests, and the "
            "motion starts and ends in passing",
            "  tolerance: 2.0e-4 # rad, how exactly commands must repeat: a UR5's repeat to 1.3e-4",
        ]
    return "\n".join(lines) + "\n"


def meant(rate: float | None) -> float | None:
    """A measured ``rate`` as it was set."""
    return None if rate is None else float(f"{rate:.4g}")


def _arm(robots: list[Finding], *, planar: bool) -> list[str]:
    """Joints, tool and locked joints of the robot, as far as its URDF leaves no choice: the whole
    arm, or the ``planar`` chain that the cameras look at.
    """
    facts = robots[0].facts if len(robots) == 1 else {}
    arms = facts.get("arms", [])
    if planar or (arms and [arms[0]["joints"]] == [c["joints"] for c in facts["chains"]]):
        return _chain(facts)
    if not arms:
        return [
            f"  joints: {OPEN} # those of the URDF that move the end-effector, base to tip",
            f"  tool: {OPEN} # link of the URDF that is the end-effector",
            "  # plane: true # where three parallel joints are analysed alone",
        ]
    tips = several([arm["tip"] for arm in arms])
    tool = f"{text_of(arms[0]['tip'])} # the last link" if len(arms) == 1 else f"{OPEN} # {tips}"
    return [
        f"  joints: [{several(arms[0]['joints'])}] # base to tip: all that move the last link",
        f"  tool: {tool}",
        "  # task: [x, y, z, rx, ry, rz] # rows of the tip's pose in the base's axes, any of them; "
        "these are the default",
        "  # locked: {joint: 0.0} # rad: joints left out above that are held elsewhere than at 0",
    ]


def _chain(facts: dict) -> list[str]:
    """The planar chain of the ``facts`` of a robot."""
    others, chains = facts.get("joints", {}).get("revolute", []), facts.get("chains", [])
    if len(chains) != 1:
        joints = (
            f"{OPEN} # the three parallel joints of the planar chain, base to tip: of "
            f"{several(others) or 'the URDF'}"
        )
        tool = f"{OPEN} # link of the URDF that is the end-effector"
    else:
        joints, tools = chains[0]["joints"], chains[0]["tools"]
        others = [joint for joint in others if joint not in joints]
        joints = f"[{several(joints)}] # base to tip: the only three in a row that are parallel"
        tool = (
            f"{text_of(tools[0])} # the only last link beyond them"
            if len(tools) == 1
            else f"{OPEN} # end-effector: {several(tools)}"
        )
    locked = (
        f"{OPEN} # rad, {{joint: angle, …}}: how {several(others) or 'the others'} "
        f"are held; {{}} where all are at 0"
    )
    return [
        f"  joints: {joints}",
        "  plane: true # the task is x, z and phi in the plane that they turn in",
        f"  tool: {tool}",
        f"  locked: {locked if others or not chains else '{} # no other joint turns'}",
    ]
