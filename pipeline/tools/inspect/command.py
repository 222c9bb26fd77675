"""``python -m pipeline inspect FILE|FOLDER [--json]``: format, rate, units and counted faults of
recordings, options that are still open, and faults that would stop the analysis.

In the table, ? marks an open option and ! a fault that stops the analysis. The stages' reader of
the format reads a file, in a separate process with bounds on time and memory.
"""

import os
import shlex
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import formats
from pipeline.arm.model import planar_tools
from pipeline.arm.urdf import SINGLE, Tree, read_urdf
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
        read = partial(_read_bounded, sandbox)
        if is_bag(place) or not place.is_dir():
            return [read(place)]
        findings = _read_folder(place, read)
    if not findings:
        stops = ["the folder holds no recordings: name another, or a file"]
        return [Finding(place, stops=stops)]
    compare_tables(findings)
    return sorted(findings, key=lambda finding: str(finding.file))


def _read_bounded(
    sandbox: Sandbox,
    file: Path,
    describe: Callable[[Path], Finding] | None = None,
) -> Finding:
    """Return the finding of a ``file`` by ``describe`` (default: as one file or bag), whose time
    and memory are bounded.
    """
    try:
        return sandbox.call(describe or describe_file, file)
    except PipelineError as error:
        return Finding(file).refuse(error)


def _read_folder(folder: Path, read: Callable[..., Finding]) -> list[Finding]:
    """Return the findings of the bags, indexes of depth frames, other files and sequences of
    numbered frames below a ``folder``.
    """
    paths = []
    for path in paths_below(folder):
        hidden = "/." in f"/{path.relative_to(folder)}"
        if not hidden and path.suffix != ".dvc":  # DVC's, as raw_files
            paths.append(path)
    bags = {path for path in paths if path.is_dir() and is_bag(path)}
    files = []
    for path in paths:
        # an unreadable folder is listed as a file, so that its finding reports the error
        readable_folder = path.is_dir() and os.access(path, os.R_OK | os.X_OK)
        if not readable_folder and bags.isdisjoint(path.parents):
            files.append(path)
    indexes = [read(file) for file in files if file.suffix.lower() in INDEXES]

    # normalise paths, since an index may contain depth/../depth/1.png
    indexed = set()
    for index in indexes:
        for file in (index.file, *index.files):
            indexed.add(os.path.normpath(file))
    findings = [*map(read, bags), *indexes]
    frames = []
    for file in files:
        if os.path.normpath(file) in indexed:
            continue
        if file.suffix.lower() in image.ENDINGS:
            frames.append(file)
        else:
            findings.append(read(file))
    for sequence in frame_sequences(frames):
        numbered = len(sequence.files) > 1
        describe = describe_numbered if numbered else describe_file
        findings.append(read(sequence.pattern, describe))
    return findings


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
        if head.text is not None and (program := foreign(head.text)):
            finding.format, advice = program
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
    first = int(take.frame[0])
    steps = int(take.frame[-1] - take.frame[0])
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
    finding.rate = record.rate
    finding.duration = float(record.time[-1] - record.time[0])
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
    if finding.kind != Kind.INTRINSICS:
        return
    if (values["width"], values["height"]) == ANY_SIZE:
        finding.facts |= {"width": None, "height": None}
        finding.ask("image_size")


def _add_bag(finding: Finding, form: Format) -> None:
    """Add the topics of a bag; the joint log of a bag that has only topics of joints."""
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
    topics = {name: [*summary.topics[name]] for name in sorted(summary.topics)}
    finding.facts["topics"] = topics
    frames_are = Kind.IMAGE if rosbag.IMAGE in types else Kind.CLOUD
    finding.facts["frames_are"] = str(frames_are)
    for option, kinds in TOPICS.items():
        names = []
        for name, (kind, count) in topics.items():
            if kind in kinds and count:
                names.append(name)
        if len(names) == 1:
            finding.facts[option.rpartition(".")[2]] = names[0]
        elif names:
            finding.ask("topic", names=", ".join(names), option=option)
    if rosbag.IMAGE in types:
        finding.ask("bag_unit")
    if not analysed:
        finding.stops.append(
            "no topic of Image, PointCloud2, WrenchStamped, JointState or "
            "JointTrajectoryControllerState with a message: nothing to analyse",
        )


def _add_robot(finding: Finding, form: Format) -> None:
    """Add joints, arms (joints from base to the tip) and planar chains of three joints."""
    tree = read_urdf(finding.file)
    joints: dict[str, list[str]] = {}
    for joint in tree.joints.values():
        joints.setdefault(joint.kind, []).append(joint.name)
    arms = _longest_arms(tree)
    chains, refusals = _planar_chains(tree, joints.get("revolute", []))
    finding.facts = {"robot": tree.name, "joints": joints}
    finding.facts |= {"arms": arms, "chains": chains}
    if refusals and not chains:
        finding.stops.append(refusals[0])
    if not (arms or chains):
        finding.stops.append("no revolute or prismatic joint moves a last link: no arm")
    elif len(chains) > 1:
        finding.ask("chain")
    elif len(chains[0]["tools"] if chains else arms) > 1:
        finding.ask("tool")


def _longest_arms(tree: Tree) -> list[dict[str, Any]]:
    """Return joints and tip of the last links that most joints move. Joints that follow another
    joint do not count.
    """
    free = set()
    for joint in tree.joints.values():
        if joint.kind in SINGLE and joint.name not in tree.couplings:
            free.add(joint.name)
    arms = []
    for tip in tree.ends:
        names = [name for name in tree.above(tip) if name in free]
        arms.append({"joints": names, "tip": tip})
    most = max((len(arm["joints"]) for arm in arms), default=0)
    return [arm for arm in arms if len(arm["joints"]) == max(most, 1)]


def _planar_chains(
    tree: Tree,
    turning: Sequence[str],
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return joints and tools of all planar chains of three of the ``turning`` joints in a row, and
    the faults of the URDF by which others are none.
    """
    chains = []
    faults = []
    for first in range(len(turning) - 2):
        chain = turning[first : first + 3]
        try:
            chains.append({"joints": chain, "tools": planar_tools(tree, chain)})
        except ConfigError as error:
            if error.message.startswith("robot.urdf"):
                faults.append(error.message)
    return chains, faults


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
