"""``python -m pipeline inspect FILE|FOLDER [--json]``: format, rate, units and counted faults of
recordings, options that are still open, and faults that would stop the analysis.

In the table, ? marks an open option and ! a fault that stops the analysis. The stages' reader of
the format reads a file, in a separate process with bounds on time and memory.
"""

import os
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pipeline import formats
from pipeline.arm.model import planar_tools
from pipeline.arm.urdf import SINGLE, read_urdf
from pipeline.core.bounds import Reading, Sandbox, read_whole, within
from pipeline.core.columns import members
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.formats import rosbag
from pipeline.formats.delimited import foreign
from pipeline.formats.depth import image
from pipeline.formats.depth.frame_names import frame_sequences
from pipeline.formats.depth.intrinsics import ANY_SIZE
from pipeline.formats.force.record import WRENCH, ForceLogOptions, require_record
from pipeline.formats.format import (
    Format,
    Head,
    Kind,
    formats_in,
    is_bag,
    is_xml,
    paths_below,
    recognised,
)
from pipeline.formats.joints.bag import FORMAT as BAG
from pipeline.formats.joints.bag import JOINT_TYPES
from pipeline.formats.motion.take import STRAY
from pipeline.formats.number_sheet import TREES
from pipeline.tools.inspect.depth import (
    add_cloud,
    add_image,
    add_index,
    describe_numbered,
)
from pipeline.tools.inspect.finding import REASONS, ROBOT, Finding, as_json, as_table
from pipeline.tools.inspect.joints import add_joint_log, add_table
from pipeline.tools.inspect.movements import compare_tables

INDEXES = (".txt", ".csv", "")  # suffixes of indexes of depth frames
LENGTH = "dataset.mocap.unit"
DEPTH_TYPES = (rosbag.IMAGE, rosbag.CLOUD)
ANALYSED = {*DEPTH_TYPES, *WRENCH, *JOINT_TYPES}  # message types
# option that names a topic → message types of the topic
TOPICS = {"force.log.topic": WRENCH, "depth.topic": DEPTH_TYPES}
TOPICS |= {"depth.camera_info": (rosbag.CAMERA_INFO,)}


def run(place: Path, reading: Sequence[str], json: bool = False) -> None:
    """Print the findings as a table or as JSON."""
    bounds = Reading(**dict(word.partition("=")[::2] for word in reading))
    findings = within(bounds, inspect, place)
    if json:
        print(as_json(findings))
        return
    print(as_table(findings, place))
    if place.is_dir():
        command = f"python -m pipeline new-dataset NAME --from {shlex.quote(str(place))} --ask"
        print(f"next: `{command}` describes these recordings as dataset NAME")


def inspect(place: Path) -> list[Finding]:
    """Return the finding of ``place``, or the findings of all recordings below ``place``. A
    recording is a file, the frames of one depth sequence or the files of one bag.

    The finding of an unreadable file has the reason in ``stops``. Raises RecordingError if
    ``place`` does not exist.
    """
    if not os.path.exists(place):
        raise RecordingError("there is no such file or folder", file=place)
    with Sandbox() as sandbox:

        def read(
            file: Path, describe: Callable[[Path], Finding] = describe_file
        ) -> Finding:
            try:
                return sandbox.call(describe, file)
            except PipelineError as error:
                return Finding(file).refuse(error)

        if is_bag(place) or not place.is_dir():
            return [read(place)]
        paths = [
            p for p in paths_below(place) if "/." not in f"/{p.relative_to(place)}"
        ]
        paths = [path for path in paths if path.suffix != ".dvc"]  # DVC's, as raw_files
        bags = {path for path in paths if path.is_dir() and is_bag(path)}
        # an unreadable folder is listed as a file, so that its finding reports the error
        files = [
            p for p in paths if not (p.is_dir() and os.access(p, os.R_OK | os.X_OK))
        ]
        files = [file for file in files if bags.isdisjoint(file.parents)]
        indexes = [read(file) for file in files if file.suffix.lower() in INDEXES]
        # normalise paths, since an index may contain depth/../depth/1.png
        placed = {
            os.path.normpath(p) for one in indexes for p in (one.file, *one.files)
        }
        rest = [file for file in files if os.path.normpath(file) not in placed]
        frames = [file for file in rest if file.suffix.lower() in image.ENDINGS]
        others = [file for file in rest if file not in frames]
        findings = [*map(read, bags), *indexes, *map(read, others)]
        for one in frame_sequences(frames):
            findings.append(
                read(one.pattern, *[describe_numbered] * (len(one.files) > 1))
            )
    if not findings:
        stops = ["the folder holds no recordings: name another, or a file"]
        return [Finding(place, stops=stops)]
    compare_tables(findings)
    return sorted(findings, key=lambda finding: str(finding.file))


def describe_file(file: Path) -> Finding:
    """Return the finding of one file or bag, read in this process."""
    finding = Finding(file)
    try:
        if is_bag(file):
            return _read(finding, rosbag.FORMAT)
        if not file.is_file():
            raise RecordingError("no readable file or folder, or a broken link")
        if file.stat().st_size == 0:
            raise RecordingError("the file is empty")
        head = Head.read(file)
        if form := recognised(head, [URDF, *formats_in(formats)]):
            return _read(finding, form)
        if head.text is not None and (known := foreign(head.text)):
            finding.format, advice = known
            raise RecordingError(f"{finding.format} is not read: {advice}")
        # at most a line of labels and a line of units, of as many cells
        marks = {max(map(line.count, ",;\t")) for line in head.lines}
        labels = len(head.lines) < 3 and len(marks) == 1 and min(marks) > 1
        reason = "no_samples" if labels else "no_table"
        if head.text is None or head.content.startswith(b"PK"):
            reason = "binary"
        elif head.suffix in TREES:
            reason = "no_camera"
        finding.facts["reason"] = REASONS[reason]
    except OSError as error:
        finding.refuse(RecordingError(f"the file cannot be read ({error.strerror})"))
    except PipelineError as error:
        finding.refuse(error)
    return finding


def _read(finding: Finding, form: Format) -> Finding:
    finding.format, finding.kind, finding.option = form.name, form.kind, form.option
    ADD[form.kind](finding, form)
    return finding


def _add_motion(finding: Finding, form: Format) -> None:
    unit = None
    try:
        take = form.read(finding.file, None)
    except RecordingError as error:
        finding.refuse(error)
        if error.evidence.get("key") != LENGTH:
            return
        unit = "not stated"  # lengths are not printed; in mm or m markers are at possible places
        try:
            take = form.read(finding.file, "mm")
        except RecordingError:
            take = form.read(finding.file, "m")
    finding.version = take.version if take.version != form.name else None
    finding.rate, finding.units = take.rate, {"length": unit or take.unit}
    first, steps = int(take.frame[0]), int(take.frame[-1] - take.frame[0])
    finding.duration = steps / take.rate
    markers = [name for name in take.markers if not STRAY.fullmatch(name)]
    if not (markers or take.bodies):
        finding.ask("markers")
    finding.facts = {
        "bodies": [*take.bodies],
        "markers": markers,
        "frames": len(take.frame),
    }
    finding.facts |= {"first_frame": first, "steps": steps, "rate_from": take.rate_from}
    finding.count({"unlabelled_markers": len(take.markers) - len(markers)})
    faults = {name: n for name, n in take.counts.items() if name != "marker_samples"}
    finding.count(faults)


def _add_trajectory(finding: Finding, form: Format) -> None:
    commanded = form.read(finding.file)
    time = commanded["t"].to_numpy()
    finding.timed(time, digits=6)
    finding.facts["steps"] = len(time) - 1
    finding.facts["commanded_joints"] = [*members(commanded, "q")]
    finding.facts["commanded_rows"] = [*members(commanded, "x")]


def _add_force(finding: Finding, form: Format) -> None:
    record = form.read(finding.file, ForceLogOptions())
    finding.rate, finding.duration = (
        record.rate,
        float(record.time[-1] - record.time[0]),
    )
    finding.units, finding.facts = dict(record.units), dict(record.marks)
    if not {"lost_packets", "missing_samples"} & {*record.counts}:
        finding.facts["times"] = "none in the log: lost rows cannot be counted"
    finding.count(record.counts)
    finding.facts |= {"samples": len(record.time), "serial": record.serial}
    require_record(record, finding.file)


def _add_calibration(finding: Finding, form: Format) -> None:
    """Add the values of a calibration of a transducer or a camera."""
    values = vars(form.read(finding.file))
    finding.facts = {name: np.asarray(value).tolist() for name, value in values.items()}
    if (
        finding.kind == Kind.INTRINSICS
        and (values["width"], values["height"]) == ANY_SIZE
    ):
        finding.facts |= {"width": None, "height": None}
        finding.ask("image_size")


def _add_bag(finding: Finding, form: Format) -> None:
    summary = form.read(finding.file)
    types = {kind for kind, count in summary.topics.values() if count}
    analysed = types & ANALYSED
    if analysed and analysed <= {*JOINT_TYPES}:
        _read(finding, BAG)
        finding.facts["passed_over"] = summary.passed_over
        return
    finding.version, finding.duration = f"ROS {summary.version}", summary.duration
    finding.count(summary.counts)
    finding.facts["passed_over"] = summary.passed_over
    topics = finding.facts["topics"] = {
        n: [*summary.topics[n]] for n in sorted(summary.topics)
    }
    finding.facts["frames_are"] = str(
        Kind.IMAGE if rosbag.IMAGE in types else Kind.CLOUD
    )
    for option, kinds in TOPICS.items():
        names = [
            name for name, (kind, count) in topics.items() if kind in kinds and count
        ]
        if len(names) == 1:
            finding.facts[option.rpartition(".")[2]] = names[0]
        elif names:
            finding.ask("topic", names=", ".join(names), option=option)
    if rosbag.IMAGE in types:
        finding.ask("bag_unit")
    if not analysed:
        known = "Image, PointCloud2, WrenchStamped, JointState or JointTrajectoryControllerState"
        finding.stops.append(f"no topic of {known} with a message: nothing to analyse")


def _add_robot(finding: Finding, form: Format) -> None:
    """Add joints, arms (joints from base to the tip) and planar chains of three joints."""
    tree = read_urdf(finding.file)
    joints: dict[str, list[str]] = {}
    for joint in tree.joints.values():
        joints.setdefault(joint.kind, []).append(joint.name)
    # exclude mimic joints, which depend on another joint
    own = {
        j.name for j in tree.joints.values() if j.kind in SINGLE and j.follows is None
    }
    moving = {
        end: [j.name for j in tree.above(end) if j.name in own] for end in tree.ends
    }
    most = max([*map(len, moving.values()), 1])
    arms = [
        {"joints": names, "tip": end}
        for end, names in moving.items()
        if len(names) == most
    ]
    turning, chains, refusals = joints.get("revolute", []), [], []
    for chain in (turning[first : first + 3] for first in range(len(turning) - 2)):
        try:
            chains.append({"joints": chain, "tools": planar_tools(tree, chain)})
        except ConfigError as error:
            refusals += [error.message] * error.message.startswith("robot.urdf")
    about = {"robot": tree.root.get("name", ""), "joints": joints}
    finding.facts = about | {"arms": arms, "chains": chains}
    if refusals and not chains:
        finding.stops.append(refusals[0])
    if not (arms or chains):
        finding.stops.append("no revolute or prismatic joint moves a last link: no arm")
    elif len(chains) > 1:
        finding.ask("chain")
    elif len(chains[0]["tools"] if chains else arms) > 1:
        finding.ask("tool")


URDF = Format("URDF", ROBOT, read_whole, is_xml("robot"))
ADD: dict[str, Callable[[Finding, Format], None]] = {
    Kind.MOTION: _add_motion,
    Kind.TRAJECTORY: _add_trajectory,
    Kind.JOINTS: add_joint_log,
    Kind.FORCE: _add_force,
    Kind.CALIBRATION: _add_calibration,
    Kind.IMAGE: add_image,
    Kind.CLOUD: add_cloud,
    Kind.INTRINSICS: _add_calibration,
    Kind.SEQUENCE: add_index,
    Kind.BAG: _add_bag,
    Kind.TABLE: add_table,
    ROBOT: _add_robot,
}
