"""Account of one file: by its kind, facts and questions from what its reader returns."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pipeline import formats
from pipeline.arm.model import load_arm
from pipeline.arm.urdf import SINGLE, read_urdf
from pipeline.core.bounds import read_whole
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.formats import rosbag
from pipeline.formats.delimited import foreign
from pipeline.formats.depth import cloud, image
from pipeline.formats.depth.image import dropped_frames, numbered_frames
from pipeline.formats.depth.intrinsics import ANY_SIZE
from pipeline.formats.force.bag import WRENCH
from pipeline.formats.force.record import ForceLogOptions, require_record
from pipeline.formats.format import Format, Head, Kind, formats_in, is_bag, is_xml, recognised
from pipeline.formats.joints.log import BAG, JOINT_STATE
from pipeline.formats.motion.take import STRAY
from pipeline.formats.number_sheet import TREES
from pipeline.tools.inspect.finding import ROBOT, Finding
from pipeline.tools.inspect.joints import joint_log, table

LENGTH, UNIT = "dataset.mocap.unit", "dataset.depth.units_per_metre"
TOTALS = ("announced_frames", "found_frames", "marker_samples", "pose_samples")  # of counts
DEPTH_TYPES = (rosbag.IMAGE, rosbag.CLOUD)
ANALYSED = {*DEPTH_TYPES, *WRENCH, JOINT_STATE}  # types of messages
# option → the types of messages of its topic
TOPICS = {"force.log.topic": WRENCH, "depth.topic": DEPTH_TYPES}
TOPICS |= {"depth.camera_info": (rosbag.CAMERA_INFO,)}
NO_CAMERA = "no camera calibration: export numbers as CSV (ros2 topic echo --csv TOPIC)"
NO_TABLE = "text without rows of numbers (between commas, semicolons, tabs or blanks)"
BINARY = (
    "binary data of no known format: unpack an archive, save arrays (HDF5, NPY, pickle) with their "
    "times in one .npz, else export as in pipeline/formats/README.md"
)


def described(file: Path) -> Finding:
    """Return the account of one file or bag, read in this process."""
    finding = Finding(file)
    try:
        if is_bag(file):
            return _read(finding, rosbag.FORMAT)
        if not file.is_file():
            raise RecordingError("this is no regular file, or a link to nothing")
        if file.stat().st_size == 0:
            raise RecordingError("the file is empty")
        head = Head.read(file)
        if form := recognised(head, [URDF, *formats_in(formats)]):
            return _read(finding, form)
        if head.text is None or head.content.startswith(b"PK"):
            finding.facts["reason"] = BINARY
        elif known := foreign(head.text):
            finding.format, advice = known
            raise RecordingError(f"{finding.format} is not read: {advice}")
        else:
            finding.facts["reason"] = NO_CAMERA if head.suffix in TREES else NO_TABLE
        return finding
    except OSError as error:
        return finding.refused(RecordingError(f"the file cannot be read ({error.strerror})"))
    except PipelineError as error:
        return finding.refused(error)


def _read(finding: Finding, form: Format) -> Finding:
    finding.format, finding.kind, finding.option = form.name, form.kind, form.option
    (_robot if form is URDF else DESCRIBE[form.kind])(finding, form)
    return finding


def _motion(finding: Finding, form: Format) -> None:
    unit = None
    try:
        take = form.read(finding.file, None)
    except RecordingError as error:
        finding.refused(error)
        if error.evidence.get("key") != LENGTH:
            return
        # no length is reported then; in the smallest unit nothing is too far away
        take, unit = form.read(finding.file, "mm"), "not stated"
    finding.version = take.version if take.version != form.name else None
    finding.rate, finding.units = take.rate, {"length": unit or take.unit}
    first, steps = int(take.frame[0]), int(take.frame[-1] - take.frame[0])
    finding.duration = steps / take.rate
    markers = [name for name in take.markers if not STRAY.fullmatch(name)]
    if not (markers or take.bodies):
        question = "no marker has a name of its own, and there is no rigid body: label them"
        finding.ask(question, "dataset.mocap.markers")
    finding.facts = {"bodies": [*take.bodies], "markers": markers, "frames": len(take.frame)}
    finding.facts |= {"first_frame": first, "steps": steps, "rate_from": take.rate_from}
    finding.count({"unlabelled_markers": len(take.markers) - len(markers)})
    finding.count({name: n for name, n in take.counts.items() if name not in TOTALS})


def _trajectory(finding: Finding, form: Format) -> None:
    t = form.read(finding.file)["t"].to_numpy()
    finding.duration, finding.facts["steps"] = float(t[-1] - t[0]), len(t) - 1
    finding.rate = round((len(t) - 1) / finding.duration, 6)


def _force(finding: Finding, form: Format) -> None:
    record = form.read(finding.file, ForceLogOptions())
    finding.rate, finding.duration = record.rate, float(record.time[-1] - record.time[0])
    finding.units, finding.facts = dict(record.units), dict(record.marks)
    if not {"lost_packets", "missing_samples"} & {*record.counts}:
        finding.facts["times"] = "none in the log: nothing shows a row that it lost"
    finding.count(record.counts)
    finding.facts |= {"samples": len(record.time), "serial": record.serial}
    require_record(record, finding.file)


def _stated(finding: Finding, form: Format) -> None:
    """Add what a calibration states: of a transducer, or of a camera."""
    values = vars(form.read(finding.file))
    finding.facts = {name: np.asarray(value).tolist() for name, value in values.items()}
    if finding.kind == Kind.INTRINSICS and (values["width"], values["height"]) == ANY_SIZE:
        finding.facts |= {"width": None, "height": None}
        question = "the size of the images that it holds for is not stated"
        finding.ask(question, "dataset.depth.width, .height")


def _image(finding: Finding, form: Format) -> None:
    shape = image.depth_size(read_whole(finding.file), file=finding.file)
    pixels = image.read_depth(finding.file, shape=shape).pixels
    measured, span = pixels[pixels > 0], ""
    # the encoding says which values stand for no depth
    share = round(1 - measured.size / pixels.size, 4)
    finding.facts = {"width": shape[1], "height": shape[0], "share_not_above_zero": share}
    finding.version = f"{8 * pixels.itemsize} bits"
    if measured.size:
        span = f", {float(measured.min()):g} to {float(measured.max()):g}"
    known = "1000 for millimetres, 5000 for TUM RGB-D, 1 for metres"
    finding.ask(f"the unit of the values{span}, is not stated ({known})", UNIT)
    known = "plain, rotated_bits (SUN RGB-D) or disparity (NYU Depth v2)"
    finding.ask(f"the encoding of the values is not stated ({known})", "dataset.depth.encoding")


def _cloud(finding: Finding, form: Format) -> None:
    from scipy.spatial.transform import Rotation

    read = form.read(read_whole(finding.file), file=finding.file)
    share = round(read.missing / max(len(read.points) + read.missing, 1), 4)
    finding.facts = {"points": len(read.points), "organised": read.organised}
    finding.facts["share_without_position"] = share
    finding.version = read.format
    finding.count(read.counts)
    if read.viewpoint != cloud.UNTURNED:
        *place, w, x, y, z = read.viewpoint
        turn = np.degrees(Rotation.from_quat([x, y, z, w]).as_rotvec())
        angle = float(np.linalg.norm(turn))
        at, about = (" ".join(f"{v + 0.0:.3g}" for v in e) for e in (place, turn / (angle or 1.0)))
        turned = f"at {at}, turned by {angle:.4g}° about {about}"
        finding.facts["viewpoint"] = f"{turned}, not applied: points are in the sensor's frame"
    question = "the unit of the coordinates is not stated (1 for metres, 1000 for millimetres)"
    finding.ask(question, UNIT)


def _index(finding: Finding, form: Format) -> None:
    index = form.read(finding.file)
    finding.count(index.counts)
    if len(index.time) > 1:
        dropped = dropped_frames(index.time)
        finding.count({"dropped_frames": dropped})
        finding.duration = float(index.time[-1] - index.time[0])
        finding.rate = round((len(index.time) - 1 + dropped) / finding.duration, 3)
    _frames(finding, index.files)


def numbered_sequence(pattern: Path) -> Finding:
    """Return the account of the numbered frames that match ``pattern``."""
    index = numbered_frames(pattern.parent, pattern.name, rate=1.0)
    finding = Finding(pattern, "depth sequence, numbered", Kind.SEQUENCE)
    finding.count({"dropped_frames": int(index.time[-1]) + 1 - len(index.files)})
    finding.ask("numbered frames have no times: their rate is not stated", "dataset.depth.rate")
    _frames(finding, index.files)
    return finding


def _frames(finding: Finding, names: Sequence[str]) -> None:
    """Add frames and the account of the first."""
    finding.files = [finding.file.parent / name for name in names]
    finding.facts["frames"] = len(names)
    there = [frame.is_file() for frame in finding.files]
    if not all(there):
        count = f"{there.count(False)} of {len(names)} frames of the index are not there"
        finding.stops.append(f"{count}: {names[there.index(False)]} …")
    if any(there):
        frame = finding.files[there.index(True)]
        try:
            first = _read(Finding(frame), cloud.FORMAT if cloud.is_cloud(frame) else image.IMAGE)
        except RecordingError as error:
            finding.stops.append(f"{frame.name}: {error.message}")
            return
        finding.version = ", ".join(filter(None, [first.format, first.version]))
        sizes = {name: first.facts[name] for name in ("width", "height") if name in first.facts}
        finding.facts |= sizes | {"frames_are": str(first.kind)}
        finding.open += first.open


def _bag(finding: Finding, form: Format) -> None:
    summary = form.read(finding.file)
    held = {kind for kind, count in summary.topics.values() if count}
    if held & ANALYSED == {JOINT_STATE}:
        _read(finding, BAG)
        return
    finding.version, finding.duration = f"ROS {summary.version}", summary.duration
    topics = finding.facts["topics"] = {n: [*summary.topics[n]] for n in sorted(summary.topics)}
    finding.facts["frames_are"] = str(Kind.IMAGE if rosbag.IMAGE in held else Kind.CLOUD)
    for option, kinds in TOPICS.items():
        names = [name for name, (kind, count) in topics.items() if kind in kinds and count]
        if len(names) == 1:
            finding.facts[option.rpartition(".")[2]] = names[0]
        elif names:
            question = f"several topics could be meant: {', '.join(names)}"
            finding.ask(question, f"dataset.{option}")
    if rosbag.IMAGE in held:
        known = "ROS drivers: 1000; images of 32 bits: 1"
        finding.ask(f"the unit of images of 16 bits is not stated ({known})", UNIT)
    if not held & ANALYSED:
        known = "Image, PointCloud2, WrenchStamped or JointState"
        finding.stops.append(f"no topic of {known} with a message: nothing that is analysed")


def _robot(finding: Finding, form: Format) -> None:
    """Add joints, arms (joints from base to tip of a last link) and planar chains of three."""
    tree = read_urdf(finding.file)
    joints: dict[str, list[str]] = {}
    for joint in tree.joints.values():
        joints.setdefault(joint.kind, []).append(joint.name)
    # a joint that follows another (mimic) has no coordinate of its own
    own = {joint.name for joint in tree.joints.values() if joint.kind in SINGLE}
    own -= {joint.name for joint in tree.joints.values() if joint.follows is not None}
    moved = {
        end: [joint.name for joint in tree.above(end) if joint.name in own] for end in tree.ends
    }
    most = max(map(len, moved.values()), default=0)
    arms = [{"joints": names, "tip": end} for end, names in moved.items() if len(names) == most > 0]
    turning, chains, refused = joints.get("revolute", []), [], []
    for chain in (turning[first : first + 3] for first in range(len(turning) - 2)):
        tools = []
        for tool in tree.ends:
            try:
                load_arm(finding.file, chain, tool, {})
                tools.append(tool)
            except ConfigError as error:
                refused += [error.message] * error.message.startswith("robot.urdf")
        chains += [{"joints": chain, "tools": tools}] if tools else []
    finding.facts = {"robot": tree.root.get("name", ""), "joints": joints}
    finding.facts |= {"arms": arms, "chains": chains}
    if refused and not chains:
        finding.stops.append(refused[0])
    if not (arms or chains):
        finding.stops.append("no joint of one coordinate moves a last link: no arm")
    elif len(chains) > 1:
        finding.ask("which three parallel joints are the chain", "dataset.robot.joints")
    elif len(chains[0]["tools"] if chains else arms) > 1:
        finding.ask("which link is the end-effector", "dataset.robot.tool")


URDF = Format("URDF", ROBOT, read_whole, is_xml("robot"))
DESCRIBE: dict[str, Callable[[Finding, Format], None]] = {
    Kind.MOTION: _motion,
    Kind.TRAJECTORY: _trajectory,
    Kind.JOINTS: joint_log,
    Kind.FORCE: _force,
    Kind.CALIBRATION: _stated,
    Kind.IMAGE: _image,
    Kind.CLOUD: _cloud,
    Kind.INTRINSICS: _stated,
    Kind.SEQUENCE: _index,
    Kind.BAG: _bag,
    Kind.TABLE: table,
}
