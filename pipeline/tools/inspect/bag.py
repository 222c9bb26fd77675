"""What a ROS bag says of itself."""

from __future__ import annotations

from pathlib import Path

from pipeline.formats.depth.messages import CAMERA_INFO, CLOUD, IMAGE
from pipeline.formats.force.bag import WRENCH
from pipeline.formats.format import Format
from pipeline.formats.joints.bag import JOINT_STATE
from pipeline.tools.inspect.depth import UNIT
from pipeline.tools.inspect.finding import Finding

DEPTH_TYPES = (IMAGE, CLOUD)


def bag(form: Format, file: Path) -> Finding:
    """A ROS bag: its topics, by its index."""
    finding, summary = Finding.read_by(form, file), form.read(file)
    finding.version, finding.duration = f"ROS {summary.version}", summary.duration
    finding.facts["topics"] = {
        topic: {"type": kind, "messages": count}
        for topic, (kind, count) in sorted(summary.topics.items())
    }
    for option, kinds in (
        ("dataset.depth.topic", DEPTH_TYPES),
        ("dataset.depth.camera_info", (CAMERA_INFO,)),
        ("dataset.force.log.topic", WRENCH),
    ):
        several = sorted(
            topic for topic, (kind, count) in summary.topics.items() if kind in kinds and count
        )
        if len(several) > 1:
            finding.open.append((f"several topics could be meant: {', '.join(several)}", option))
    held = _held(finding)
    if IMAGE in held:
        finding.open.append(
            (
                "the unit of images of 16 bits is not stated (ROS drivers: 1000; images of 32 "
                "bits: 1)",
                UNIT,
            )
        )
    if not held & {IMAGE, CLOUD, *WRENCH, JOINT_STATE}:
        finding.stops.append(
            "no topic of Image, PointCloud2, WrenchStamped or JointState with a message: nothing "
            "that is analysed"
        )
    return finding


def is_of_joints(bag: Finding) -> bool:
    """Whether a bag holds angles of joints, and nothing else that is analysed."""
    return JOINT_STATE in _held(bag) and not _held(bag) & {IMAGE, CLOUD, *WRENCH}


def _held(bag: Finding) -> set[str]:
    """The types of its messages."""
    return {topic["type"] for topic in bag.facts["topics"].values() if topic["messages"]}
