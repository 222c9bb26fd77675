"""C3D files for tests, as bytes."""

import struct
from typing import NamedTuple

import numpy as np
from numpy.random import default_rng

AB = ["Arm:a", "Arm:b"]
DEC = 85
BLOCK = 512  # bytes


def points(frames: int = 40, markers: int = 2, seed: int = 1) -> np.ndarray:
    """(frames, markers, 3) m, rounded to what a C3D file holds of millimetres."""
    drawn = default_rng(seed).normal(size=(frames, markers, 3))
    return (1000 * drawn).astype(np.float32).astype(float) / 1000


class Parameter(NamedTuple):
    """Bytes of a number (-1 for text), sizes of the dimensions, and data."""

    kind: int
    sizes: list[int]
    data: bytes


def words(*values: int) -> bytes:
    return struct.pack(f"<{len(values)}H", *values)


def word(value: int) -> Parameter:
    return Parameter(2, [], words(value))


def long_word(value: int) -> Parameter:
    """A number of 32 bits as two words."""
    return Parameter(2, [2], words(value % 2**16, value >> 16))


def texts(items: list[str]) -> Parameter:
    return Parameter(-1, [16, len(items)], "".join(s.ljust(16) for s in items).encode())


def numbers(values: object, processor: int) -> bytes:
    """Floating-point ``values`` as Intel's processors or DEC's (times 4, words swapped) do."""
    plain = np.atleast_1d(np.asarray(values, dtype="<f4"))
    if processor == DEC:
        return (4 * plain).view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return plain.tobytes()


def real(value: float, processor: int) -> Parameter:
    return Parameter(4, [], numbers(value, processor))


def analog_parameters(
    channels: list[str],
    rate: float,
    processor: int,
) -> dict[str, Parameter]:
    """The parameters of the analog ``channels``, sampled at ``rate``."""
    count = len(channels)
    parameters = {"USED": word(count)}
    if channels:
        ones = numbers(np.ones(count), processor)
        parameters["LABELS"] = texts(channels)
        parameters["GEN_SCALE"] = real(1, processor)
        parameters["SCALE"] = Parameter(4, [count], ones)
        parameters["OFFSET"] = Parameter(2, [count], words(*[0] * count))
        parameters["RATE"] = real(rate, processor)
    return parameters


def group(number: int, name: str, parameters: dict[str, Parameter]) -> bytes:
    """A group of parameters by their names."""
    content = struct.pack("<bb", len(name), -number) + name.encode()
    content += struct.pack("<HB", 3, 0)

    for label, (kind, sizes, data) in parameters.items():
        shape = struct.pack("<bB", kind, len(sizes)) + bytes(sizes)
        body = shape + data + b"\0"
        content += struct.pack("<bb", len(label), number)
        content += label.encode()
        content += struct.pack("<H", len(body) + 2)
        content += body
    return content


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
    ``analogs`` channel → samples per frame, ``groups`` further lists of labels.
    """
    xyz = points(5) if xyz is None else xyz
    frames, count, _ = xyz.shape
    channels = [*(analogs or {})]
    ratio = max([*(analogs or {}).values(), 0])
    samples = len(channels) * ratio  # of a frame

    of_points = {"USED": word(count), "SCALE": real(-1, processor)}
    of_points |= {"RATE": real(rate, processor), "DATA_START": word(4)}
    of_points["FRAMES"] = word(min(frames, 65535))
    if long_frames is not None:
        of_points["LONG_FRAMES"] = real(long_frames, processor)
    of_points["LABELS"] = texts(labels[:255])
    of_points["UNITS"] = Parameter(-1, [len(unit)], unit.encode())
    for name, items in {"LABELS2": labels[255:], **(groups or {})}.items():
        if items:
            of_points[name] = texts(items)
    of_analogs = analog_parameters(channels, ratio * rate, processor)
    trial = {"ACTUAL_START_FIELD": start, "ACTUAL_END_FIELD": end}
    of_trial = {key: long_word(n) for key, n in trial.items() if n is not None}

    parameters = group(1, "POINT", of_points) + group(2, "ANALOG", of_analogs)
    parameters += group(3, "FORCE_PLATFORM", {"USED": word(0)})
    if of_trial:
        parameters += group(4, "TRIAL", of_trial)
    blocks = -(-(len(parameters) + 6) // BLOCK)
    data_start = 2 + blocks
    parameters = bytes([1, 80, blocks, processor]) + parameters
    parameters = with_data_start(parameters, data_start).ljust(blocks * BLOCK, b"\0")

    last = first + frames - 1 if last is None else last
    head = struct.pack("<BB5H", 2, 80, count, samples, first, last, 10)
    head += numbers(-1, processor) + words(data_start, ratio) + numbers(rate, processor)

    residuals = np.zeros((frames, count, 1))
    if residual is not None:
        residuals[residual] = -1
    values = np.concatenate([scale * xyz, residuals], axis=2).reshape(frames, -1)
    table = np.hstack([values, np.zeros((frames, samples))])
    return head.ljust(BLOCK, b"\0") + parameters + numbers(table, processor)
