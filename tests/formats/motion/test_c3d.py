"""C3D takes that ezc3d writes: points, units, missing samples, and what is refused."""

from __future__ import annotations

import time
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motive_files import refusal

from pipeline.core.bounds import Reading, within
from pipeline.core.errors import RecordingError
from pipeline.formats.motion import c3d
from pipeline.formats.motion.c3d import read_c3d


def points(frames: int = 40, markers: int = 3, seed: int = 1) -> np.ndarray:
    """(frames, markers, 3) m, rounded to what a C3D file holds of millimetres."""
    drawn = np.random.default_rng(seed).normal(size=(frames, markers, 3))
    return (1000 * drawn).astype(np.float32).astype(float) / 1000


def write(
    file: Path, xyz: np.ndarray, *, unit: str = "mm", scale: float = 1e3, labels="ABC", analog=0
) -> Path:
    recording = ezc3d.c3d()
    homogeneous = np.ones((4, xyz.shape[1], xyz.shape[0]))
    homogeneous[:3] = (scale * xyz).transpose(2, 1, 0)
    recording["data"]["points"] = homogeneous
    held = {"RATE": [100.0], "LABELS": list(labels), "UNITS": [unit] if unit else []}
    for name, value in held.items():
        recording["parameters"]["POINT"][name]["value"] = value
    if analog:
        recording["parameters"]["ANALOG"]["RATE"]["value"] = [1000.0]
        recording["parameters"]["ANALOG"]["LABELS"]["value"] = [f"F{i}" for i in range(analog)]
        recording["data"]["analogs"] = np.ones((1, analog, 10 * len(xyz)))
        recording.add_parameter("FORCE_PLATFORM", "USED", [1])
    recording.write(str(file))
    return file


@pytest.mark.parametrize(
    ("unit", "scale", "analog"), [("mm", 1e3, 0), ("MM", 1e3, 6), ("cm", 100.0, 0), ("m", 1.0, 0)]
)
def test_points_come_back_in_metres_whatever_is_recorded_beside_them(tmp_path, unit, scale, analog):
    xyz = points()
    result = read_c3d(write(tmp_path / "t.c3d", xyz, unit=unit, scale=scale, analog=analog))
    assert (result.name, result.version, result.rate) == ("t", "C3D", 100.0)
    assert list(result.markers) == ["A", "B", "C"]
    for i, name in enumerate("ABC"):
        np.testing.assert_allclose(result.markers[name], xyz[:, i], rtol=0, atol=3e-7)
    np.testing.assert_allclose(result.time, np.arange(40) / 100, rtol=0, atol=1e-12)
    names = ("found_frames", "missing_samples", "gaps")
    assert [result.counts[name] for name in names] == [40, 0, 0]
    names = ("skipped_analog_channels", "skipped_force_plates")
    assert [result.counts.get(name, 0) for name in names] == ([6, 1] if analog else [0, 0])


def test_a_negative_residual_and_coordinates_that_are_none_are_missing_samples(tmp_path):
    xyz = points(6)
    xyz[2, 1], xyz[3, 1] = np.nan, 0
    file = write(tmp_path / "t.c3d", xyz)
    plain, content = read_c3d(file), bytearray(file.read_bytes())
    assert np.isnan(plain.markers["B"][[2, 3]]).all() and plain.counts["missing_samples"] == 2
    # the fourth word of each sample is its residual and camera mask
    start = (int.from_bytes(content[16:18], "little") - 1) * 512
    content[start + 12 : start + 16] = np.float32(-1).tobytes()
    file.write_bytes(content)
    result = read_c3d(file)
    assert np.isnan(result.markers["A"][0]).all() and np.isfinite(result.markers["A"][1:]).all()
    assert result.counts["missing_samples"] == 3


def test_labels_are_kept_apart_and_a_unit_is_stated_or_asked_for(tmp_path):
    xyz = points(4)
    result = read_c3d(write(tmp_path / "t.c3d", xyz, labels=("A", "A", "")))
    assert list(result.markers) == ["A [1]", "A [2]", "Point 3"]
    assert result.counts["unlabelled_points"] == 1
    file = write(tmp_path / "u.c3d", xyz, unit="")
    assert refusal(read_c3d, file).evidence["key"] == "dataset.mocap.unit"
    np.testing.assert_allclose(read_c3d(file, "mm").markers["A"], xyz[:, 0], rtol=0, atol=3e-7)
    stated = write(tmp_path / "v.c3d", xyz)
    assert refusal(lambda file: read_c3d(file, "m"), stated).evidence["key"] == "dataset.mocap.unit"
    assert "furlong" in refusal(read_c3d, write(tmp_path / "w.c3d", xyz, unit="furlong")).message


def after(name: bytes, content: bytes) -> int:
    """Place of the number of dimensions of a parameter in a file's content: behind its name, a word
    and a type.
    """
    return content.index(name) + len(name) + 3


def test_a_file_without_a_rate_or_that_crashes_the_library_is_refused(tmp_path):
    file = write(tmp_path / "t.c3d", points(4))
    content = bytearray(file.read_bytes())
    damaged = bytearray(content)
    for place in (20, after(b"RATE", content) + 1):  # in the header and in POINT
        content[place : place + 4] = bytes(4)
    file.write_bytes(content)
    assert refusal(read_c3d, file).evidence["key"] == "POINT:RATE"
    damaged[after(b"DATA_START", damaged)] = 130
    file.write_bytes(damaged)
    assert "damaged" in refusal(read_c3d, file).message


@pytest.mark.parametrize(
    "content", [b"", b"\2P", b"Format Version,1.23\n" * 100, b"\2P" + bytes(1022), bytes(4096)]
)
def test_other_files_and_none_are_refused(tmp_path, content):
    (tmp_path / "t.c3d").write_bytes(content)
    for file in (tmp_path / "t.c3d", tmp_path / "absent.c3d", tmp_path):
        refusal(read_c3d, file)


def _never(file: str) -> None:
    time.sleep(60)


@pytest.mark.parametrize(
    ("bounds", "bound"), [(Reading(seconds=1), "seconds"), (Reading(markers=1), "markers")]
)
def test_a_file_that_is_beyond_a_bound_names_it(tmp_path, monkeypatch, bounds, bound):
    if bound == "seconds":  # the library never returns
        monkeypatch.setattr(c3d, "read_contents", _never)
    file = write(tmp_path / "t.c3d", points(4))
    error = refusal(lambda file: within(bounds, read_c3d, file), file)
    assert error.evidence["bound"] == f"dataset.reading.{bound}"


@pytest.mark.slow
@settings(derandomize=True, max_examples=15, deadline=None)
@given(cut=st.floats(0, 1, exclude_max=True))
def test_a_file_cut_at_any_byte_is_refused_or_whole(tmp_path_factory, cut):
    file = write(tmp_path_factory.mktemp("cut") / "t.c3d", points())
    whole, content = read_c3d(file), file.read_bytes()
    file.write_bytes(content[: int(cut * len(content))])
    try:
        result = read_c3d(file)
    except RecordingError:
        return
    # the library pads files to blocks of 512 bytes
    assert all((result.markers[name] == whole.markers[name]).all() for name in whole.markers)
