"""C3D files for tests, as bytes."""

import struct

import numpy as np

AB = ["Arm:a", "Arm:b"]
DEC = 85


def points(frames: int = 40, markers: int = 2, seed: int = 1) -> np.ndarray:
    """(frames, markers, 3) m, rounded to what a C3D file holds of millimetres."""
    drawn = np.random.default_rng(seed).normal(size=(frames, markers, 3))
    return (1000 * drawn).astype(np.float32).astype(float) / 1000


def parameter(group: int, name: str, kind: int, sizes: list[int], data: bytes) -> bytes:
    body = struct.pack("<bB", kind, len(sizes)) + bytes(sizes) + data + b"\0"
    head = struct.pack("<bb", len(name), group) + name.encode()
    return head + struct.pack("<H", len(body) + 2) + body


def texts(group: int, name: str, items: list[str]) -> bytes:
    data = b"".join(item.encode().ljust(16) for item in items)
    return parameter(group, name, -1, [16, len(items)], data)


def numbers(values: object, processor: int) -> bytes:
    """Floating-point ``values`` as Intel's processors or DEC's (times 4, words swapped) do."""
    plain = np.atleast_1d(np.asarray(values, dtype="<f4"))
    if processor == DEC:
        return (4 * plain).view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return plain.tobytes()


def words(*values: int) -> bytes:
    return struct.pack(f"<{len(values)}H", *values)


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

    def group(number: int, name: str) -> bytes:
        return (
            struct.pack("<bb", len(name), -number)
            + name.encode()
            + struct.pack("<HB", 3, 0)
        )

    xyz = points(5) if xyz is None else xyz
    frames, count, _ = xyz.shape
    body = group(1, "POINT") + parameter(1, "USED", 2, [], words(count))
    body += parameter(1, "SCALE", 4, [], numbers(-1, processor))
    body += parameter(1, "RATE", 4, [], numbers(rate, processor))
    body += parameter(1, "DATA_START", 2, [], words(4))
    body += parameter(1, "FRAMES", 2, [], words(min(frames, 65535)))
    if long_frames is not None:
        body += parameter(1, "LONG_FRAMES", 4, [], numbers(long_frames, processor))
    body += texts(1, "LABELS", labels[:255]) + parameter(
        1, "UNITS", -1, [len(unit)], unit.encode()
    )
    for name, items in {"LABELS2": labels[255:], **(groups or {})}.items():
        body += texts(1, name, items) if items else b""
    channels, ratio = [*(analogs or {})], max([*(analogs or {}).values(), 0])
    body += group(2, "ANALOG") + parameter(2, "USED", 2, [], words(len(channels)))
    if channels:
        body += texts(2, "LABELS", channels) + parameter(
            2, "GEN_SCALE", 4, [], numbers(1, processor)
        )
        scales = numbers(np.ones(len(channels)), processor)
        body += parameter(2, "SCALE", 4, [len(channels)], scales)
        body += parameter(2, "OFFSET", 2, [len(channels)], words(*[0] * len(channels)))
        body += parameter(2, "RATE", 4, [], numbers(ratio * rate, processor))
    body += group(3, "FORCE_PLATFORM") + parameter(3, "USED", 2, [], words(0))
    if start is not None:
        held = words(start % 2**16, start >> 16)
        body += group(4, "TRIAL") + parameter(4, "ACTUAL_START_FIELD", 2, [2], held)
    if end is not None:
        body += parameter(4, "ACTUAL_END_FIELD", 2, [2], words(end % 2**16, end >> 16))
    blocks = -(-(len(body) + 6) // 512)
    at = body.index(b"DATA_START") + len("DATA_START") + 4
    body = body[:at] + words(2 + blocks) + body[at + 2 :]
    ends = first, first + frames - 1 if last is None else last
    head = struct.pack("<BB5H", 2, 80, count, len(channels) * ratio, *ends, 10)
    head += numbers(-1, processor) + words(2 + blocks, ratio) + numbers(rate, processor)
    data = np.concatenate([scale * xyz, np.zeros((frames, count, 1))], axis=2)
    if residual is not None:
        data[residual][3] = -1
    parameters = (bytes([1, 80, blocks, processor]) + body).ljust(blocks * 512, b"\0")
    data = np.hstack(
        [data.reshape(frames, -1), np.zeros((frames, len(channels) * ratio))]
    )
    return head.ljust(512, b"\0") + parameters + numbers(data, processor)
