"""C3D files for tests, as bytes."""

import struct
from collections.abc import Sequence

import numpy as np

AB = ["Arm:a", "Arm:b"]
DEC = 85
BLOCK = 512  # bytes


def points(frames: int = 40, markers: int = 2, seed: int = 1) -> np.ndarray:
    """(frames, markers, 3) m, rounded to what a C3D file holds of millimetres."""
    drawn = np.random.default_rng(seed).normal(size=(frames, markers, 3))
    return (1000 * drawn).astype(np.float32).astype(float) / 1000


def group(number: int, name: str) -> bytes:
    """The head of a group of parameters."""
    head = struct.pack("<bb", len(name), -number) + name.encode()
    return head + struct.pack("<HB", 3, 0)


def parameter(
    group: int,
    name: str,
    kind: int,
    sizes: Sequence[int],
    data: bytes,
) -> bytes:
    """A parameter of a ``group``: its ``kind`` is the bytes of a number, -1 for text."""
    body = struct.pack("<bB", kind, len(sizes))
    body += bytes(sizes) + data + b"\0"
    head = struct.pack("<bb", len(name), group) + name.encode()
    return head + struct.pack("<H", len(body) + 2) + body


def texts(group: int, name: str, items: list[str]) -> bytes:
    data = b"".join(item.encode().ljust(16) for item in items)
    return parameter(group, name, -1, [16, len(items)], data)


def words(*values: int) -> bytes:
    return struct.pack(f"<{len(values)}H", *values)


def long_words(value: int) -> bytes:
    """A number of 32 bits as two words."""
    return words(value % 2**16, value >> 16)


def numbers(values: object, processor: int) -> bytes:
    """Floating-point ``values`` as Intel's processors or DEC's (times 4, words swapped) do."""
    plain = np.atleast_1d(np.asarray(values, dtype="<f4"))
    if processor == DEC:
        return (4 * plain).view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return plain.tobytes()


def point_group(
    labels: list[str],
    frames: int,
    count: int,
    rate: float,
    unit: str,
    processor: int,
    long_frames: int | None,
    groups: dict[str, list[str]],
) -> bytes:
    """The parameters of the points; ``groups`` are more lists of labels."""
    group_of_points = group(1, "POINT")
    group_of_points += parameter(1, "USED", 2, [], words(count))
    group_of_points += parameter(1, "SCALE", 4, [], numbers(-1, processor))
    group_of_points += parameter(1, "RATE", 4, [], numbers(rate, processor))
    group_of_points += parameter(1, "DATA_START", 2, [], words(4))
    group_of_points += parameter(1, "FRAMES", 2, [], words(min(frames, 65535)))

    if long_frames is not None:
        stated = numbers(long_frames, processor)
        group_of_points += parameter(1, "LONG_FRAMES", 4, [], stated)
    group_of_points += texts(1, "LABELS", labels[:255])
    group_of_points += parameter(1, "UNITS", -1, [len(unit)], unit.encode())

    for name, items in {"LABELS2": labels[255:], **groups}.items():
        if items:
            group_of_points += texts(1, name, items)
    return group_of_points


def analog_group(channels: list[str], rate: float, processor: int) -> bytes:
    """The parameters of the analog ``channels``, sampled at ``rate``."""
    count = len(channels)
    parameters = group(2, "ANALOG") + parameter(2, "USED", 2, [], words(count))
    if channels:
        parameters += texts(2, "LABELS", channels)
        parameters += parameter(2, "GEN_SCALE", 4, [], numbers(1, processor))
        scales = numbers(np.ones(count), processor)
        parameters += parameter(2, "SCALE", 4, [count], scales)
        parameters += parameter(2, "OFFSET", 2, [count], words(*[0] * count))
        parameters += parameter(2, "RATE", 4, [], numbers(rate, processor))
    return parameters


def with_data_start(parameters: bytes, block: int) -> bytes:
    """The ``parameters`` with the number of the first block of data."""
    at = parameters.index(b"DATA_START") + len("DATA_START") + 4
    return parameters[:at] + words(block) + parameters[at + 2 :]


def c3d(
    labels: list[str] = AB,
    xyz: np.ndarray | None = None,
    *,
    unit: str = "mm",
    scale: float = 1e3,
    rate: float = 100.0,
    first: int = 1,
    groups: dict[str, list[str]] | None = None,
    start: int | None = None,
    end: int | None = None,
    long_frames: int | None = None,
    last: int | None = None,
    analogs: dict[str, int] | None = None,
    processor: int = 84,
    residual: tuple[int, int] | None = None,
) -> bytes:
    """A C3D of floating point; ``residual`` is negative at a frame and point. ``start``, ``end``,
    ``long_frames`` are the numbers in TRIAL and POINT, ``last`` another last frame in the header,
    ``analogs`` channel → samples per frame.
    """
    xyz = points(5) if xyz is None else xyz
    frames, count, _ = xyz.shape
    analogs = analogs or {}
    ratio = max([*analogs.values(), 0])
    samples = len(analogs) * ratio  # of a frame

    parameters = point_group(
        labels,
        frames,
        count,
        rate,
        unit,
        processor,
        long_frames,
        groups or {},
    )
    parameters += analog_group([*analogs], ratio * rate, processor)
    parameters += group(3, "FORCE_PLATFORM") + parameter(3, "USED", 2, [], words(0))
    if start is not None:
        parameters += group(4, "TRIAL")
        parameters += parameter(4, "ACTUAL_START_FIELD", 2, [2], long_words(start))
    if end is not None:
        parameters += parameter(4, "ACTUAL_END_FIELD", 2, [2], long_words(end))
    blocks = -(-(len(parameters) + 6) // BLOCK)
    data_start = 2 + blocks
    parameters = bytes([1, 80, blocks, processor]) + parameters
    parameters = with_data_start(parameters, data_start).ljust(blocks * BLOCK, b"\0")

    if last is None:
        last = first + frames - 1
    head = struct.pack("<BB5H", 2, 80, count, samples, first, last, 10)
    head += numbers(-1, processor) + words(data_start, ratio) + numbers(rate, processor)

    values = np.concatenate([scale * xyz, np.zeros((frames, count, 1))], axis=2)
    if residual is not None:
        values[residual][3] = -1
    table = np.hstack([values.reshape(frames, -1), np.zeros((frames, samples))])
    return head.ljust(BLOCK, b"\0") + parameters + numbers(table, processor)
