"""Forces in ROS bags: WrenchStamped messages, in N and N·m by definition."""

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import NO_OPTIONS, ForceLogOptions, ForceRecord, timed_record
from pipeline.formats.format import Format, Kind

WRENCH = ("geometry_msgs/msg/WrenchStamped",)


def read_force_bag(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record of the option ``topic`` (default the only WrenchStamped topic) in the bag
    ``file``, at the times of the message headers; ``counts`` as in :func:`read_force_table`.

    Raises RecordingError for an unreadable bag, for no topic or several; with the sample number
    (from 0), where a value is not finite or the time decreases.
    """
    # here, since most force logs are no bags
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
