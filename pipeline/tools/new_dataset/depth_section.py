"""Section ``depth`` of a new dataset's datasheet."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.formats.depth.messages import CAMERA_INFO, IMAGE
from pipeline.formats.format import Kind
from pipeline.tools.inspect.bag import DEPTH_TYPES
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.layout import Layout
from pipeline.tools.new_dataset.yaml_text import OPEN, agreed, one_of, text_of


def depth_section(layout: Layout, below: Callable[[Finding], str]) -> list[str]:
    group = max(layout.depth, key=lambda group: len(group.takes))
    takes = list(group.takes.values())
    place, first = next(iter(group.takes.items()))
    bag = "topics" in first.facts
    lines = [
        "depth:",
        f"  takes: {text_of(group.pattern)} # one for each test take of the motion capture, of its "
        "name",
    ]
    if len(layout.depth) > 1:
        lines[1] = (
            f"  takes: {one_of(text_of(group.pattern) for group in layout.depth)} # one for each "
            "test take, of its name"
        )
    if first.option == "index":
        lines.append(f"  index: {text_of(first.file.relative_to(place).as_posix())}")
    elif not bag:
        lines.append(f"  frames: {text_of(first.file.relative_to(place).as_posix())}")
    if bag:
        lines += _topics(first)
    clouds = IMAGE not in _kinds(first) if bag else first.facts.get("frames_are") == Kind.CLOUD
    if not clouds:
        calibrations = [below(finding) for finding in layout.single.get(Kind.INTRINSICS, [])]
        if calibrations or not bag:
            chosen = calibrations[0] if len(calibrations) == 1 else one_of(calibrations)
            lines.append(f"  intrinsics: {chosen}")
        lines += [
            f"  {name}: {agreed(take.facts.get(name) for take in takes)} # px"
            for name in ("width", "height")
        ]
    rates = sorted(take.rate for take in takes if take.rate)
    rate = (
        f"{rates[len(rates) // 2]:.4g} # 1/s, as the indexes have it"
        if rates and not bag
        else f"{OPEN} # 1/s"
    )
    lines += [
        f"  encoding: {'plain' if clouds else OPEN} # by the recorder's manual: plain, "
        "rotated_bits (SUN RGB-D), disparity (NYU)",
        f"  units_per_metre: {OPEN} # by its manual: 1000 for millimetres, 5000 for TUM RGB-D, 1 "
        f"for metres{_values(first)}",
        f"  rate: {rate}",
        "  start: null # s on the camera's clock when the motion capture starts, as far as "
        "known; null: at its first frame",
        "  clock_offset: null # s still to add to read the motion capture's clock; null: estimated",
        "  camera: # x right, y down, z forward, in the arm's base frame",
        f"    position: {OPEN} # m, [x, y, z], by a hand-eye calibration",
        f"    rpy: {OPEN} # rad, about the fixed axes x, y, z, likewise",
    ]
    return lines


def _kinds(bag: Finding) -> set[str]:
    return {topic["type"] for topic in bag.facts["topics"].values() if topic["messages"]}


def _topics(bag: Finding) -> list[str]:
    lines = []
    for key, kinds in (("topic", DEPTH_TYPES), ("camera_info", (CAMERA_INFO,))):
        topics = [
            text_of(name)
            for name, topic in bag.facts["topics"].items()
            if topic["type"] in kinds and topic["messages"]
        ]
        if topics:
            lines.append(f"  {key}: {topics[0] if len(topics) == 1 else one_of(topics)}")
    return lines


def _values(finding: Finding) -> str:
    values = finding.facts.get("first_values")
    return f"; the first frame holds {values[0]:g} to {values[1]:g}" if values else ""
