"""Forces in ROS bags: messages WrenchStamped, in N and N·m by the definition of their type."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import (
    NO_OPTIONS,
    OPTION,
    ForceLogOptions,
    ForceRecord,
    repeats,
    with_torque,
)
from pipeline.formats.force.table import rate_of, read_clock
from pipeline.formats.format import Format, Kind

WRENCH = ("geometry_msgs/msg/WrenchStamped",)


def read_force_bag(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record of the option's ``topic`` in the bag ``file``, or of the only one of its
    type; times are those of the messages' headers.

    ``counts``: ``repeated_rows`` and ``zero_rows``, both kept, and those of
    :func:`pipeline.formats.force.table.read_clock`. Raises RecordingError for a bag that cannot be
    read, no topic or more than one, no message, values that are not finite, and times as there;
    samples count from 0.
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
    keep, counts = read_clock(time, values, [*range(len(time))], place="sample", file=file)
    time, values = time[keep], values[keep]
    return ForceRecord(time, *with_torque(values), rate_of(time), "", "", repeats(values) | counts)


def _sample(message: object) -> list[float]:
    from pipeline.formats.rosbag import seconds

    wrench = message.wrench
    axes = [getattr(part, axis) for part in (wrench.force, wrench.torque) for axis in "xyz"]
    return [seconds(message), *axes]


FORMAT = Format("forces in a ROS bag", Kind.FORCE, read_force_bag, option="bag")
