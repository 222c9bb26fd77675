"""Forces in ROS bags: messages WrenchStamped, in N and N·m by the definition of their type."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force import record
from pipeline.formats.force.record import NO_OPTIONS, OPTION, ForceLogOptions, ForceRecord
from pipeline.formats.format import Format, Kind

WRENCH = ("geometry_msgs/msg/WrenchStamped",)


def read_force_bag(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record of the option's ``topic`` in the bag ``file``, or of the only one of its
    type; times are those of the messages' headers, ``counts`` those of a table of forces.

    Raises RecordingError for a bag that cannot be read, no topic or more than one, no message, and
    values that are not finite or times that go back, by the sample from 0.
    """
    # here, as most force logs are no bags
    from pipeline.formats.rosbag import choose_topic, messages

    topic = choose_topic(file, WRENCH, options.topic)
    where = {"file": file, "topic": topic}
    samples = np.array([*messages(file, topic, _sample)])
    if not len(samples):
        raise RecordingError("the topic holds no message", key=f"{OPTION}.topic", **where)
    time, values = samples[:, 0] - samples[0, 0], samples[:, 1:]
    broken = ~np.isfinite(values).all(axis=1)
    if broken.any():
        first = int(np.argmax(broken))
        raise RecordingError("a force or torque is not finite", sample=first, **where)
    places = [*range(len(time))]
    keep, counts = record.read_clock(time, values, places, place="sample", file=file)
    time, values = time[keep], values[keep]
    counts |= record.repeats(values)
    parts = record.with_torque(values)
    return ForceRecord(time, *parts, record.rate_of(time), "", "", counts)


def _sample(message: object) -> list[float]:
    from pipeline.formats.rosbag import seconds

    wrench = message.wrench
    axes = [getattr(part, axis) for part in (wrench.force, wrench.torque) for axis in "xyz"]
    return [seconds(message), *axes]


FORMAT = Format("forces in a ROS bag", Kind.FORCE, read_force_bag, option="bag")
