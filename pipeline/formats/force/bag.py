"""Forces in ROS bags: messages of the type WrenchStamped, in N and N·m by the definition of their
type.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.clock import rate_of, read_clock
from pipeline.formats.force.record import OPTION, ForceLogOptions, ForceRecord, repeats, with_torque
from pipeline.formats.format import Format, Kind

WRENCH = ("geometry_msgs/msg/WrenchStamped",)
NO_OPTIONS = ForceLogOptions()


def read_force_bag(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Record of the option's ``topic`` in the bag ``file``, or of the only one of its type; times
    are those of the messages' headers.

    ``counts``: ``repeated_rows`` and ``zero_rows``, both kept, and those of
    :func:`pipeline.formats.force.clock.read_clock`. Raises RecordingError for a bag that cannot be
    read, no topic or more than one, no message, values that are not finite, and times as there;
    samples count from 0.
    """
    # here, as most force logs are no bags
    from pipeline.formats.rosbag import choose_topic, messages, seconds

    topic = choose_topic(file, WRENCH, options.topic)
    samples = [
        (seconds(message, file=file, topic=topic), _axes(message.wrench))
        for message in messages(file, topic)
    ]
    if not samples:
        raise RecordingError(
            "the topic holds no message", file=file, topic=topic, key=f"{OPTION}.topic"
        )
    time, values = (
        np.array([stamp for stamp, _ in samples]),
        np.array([axes for _, axes in samples]),
    )
    broken = ~np.isfinite(values).all(axis=1)
    if broken.any():
        raise RecordingError(
            "a force or torque is not finite", file=file, topic=topic, sample=int(np.argmax(broken))
        )
    keep, counts = read_clock(
        time - time[0], values, list(range(len(time))), place="sample", file=file
    )
    time, values = (time - time[0])[keep], values[keep]
    return ForceRecord(time, *with_torque(values), rate_of(time), "", "", repeats(values) | counts)


def _axes(wrench: object) -> list[float]:
    return [getattr(part, axis) for part in (wrench.force, wrench.torque) for axis in "xyz"]


FORMAT = Format("forces in a ROS bag", Kind.FORCE, read_force_bag, option="bag")
