"""Forces in ROS bags: messages WrenchStamped, in N and N·m by the definition of their type."""

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import NO_OPTIONS, ForceLogOptions, ForceRecord, timed_record
from pipeline.formats.format import Format, Kind

WRENCH = ("geometry_msgs/msg/WrenchStamped",)


def read_force_bag(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record of the option's ``topic`` in the bag ``file``, or of the only one of its
    type; times are those of the messages' headers, ``counts`` those of a table of forces.

    Raises RecordingError for a bag that cannot be read, no topic or more than one, and values that
    are not finite or times that go back, by the sample from 0.
    """
    # here, as most force logs are no bags
    from pipeline.formats.rosbag import choose_topic, messages

    topic = choose_topic(file, WRENCH, options.topic)
    samples = np.array([*messages(file, topic, _sample)])
    if not (finite := np.isfinite(samples).all(axis=1)).all():
        where = {"file": file, "topic": topic, "sample": int(np.argmin(finite))}
        raise RecordingError("a force or torque is not finite", **where)
    places = ("sample", range(len(samples)))
    return timed_record(samples[:, 0], samples[:, 1:], places, file, {})


def _sample(message: object) -> list[float]:
    from pipeline.formats.rosbag import seconds

    wrench = message.wrench
    axes = [getattr(part, axis) for part in (wrench.force, wrench.torque) for axis in "xyz"]
    return [seconds(message), *axes]


FORMAT = Format("forces in a ROS bag", Kind.FORCE, read_force_bag, option="bag")
