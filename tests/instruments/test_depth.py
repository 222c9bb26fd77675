from __future__ import annotations

import time

import cv2
import numpy as np
import pytest

from pipeline.errors import RecordingError
from pipeline.instruments.depth import (
    Intrinsics,
    metres,
    read_depth,
    read_index,
    read_intrinsics,
    write_depth,
    write_index,
    write_intrinsics,
)

SHAPE = (424, 512)


def frame(seed: int = 1, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    generator = np.random.default_rng(seed)
    raw = 1800 + 0.5 * np.arange(shape[1]) + 0.3 * np.arange(shape[0])[:, None] + generator.normal(size=shape) * 5
    raw[generator.random(shape) < 0.2] = 0
    return raw.astype(np.uint16)


def refused(call, *arguments, **keywords) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        call(*arguments, **keywords)
    assert caught.value.evidence["file"] == arguments[0]
    return caught.value


# --- frames


@pytest.mark.parametrize(
    ("name", "largest", "zeros", "units"), [("depth_millimetres.png", 2702, 0.1304, 1000), ("depth_tum_scale5000.png", 46655, 0.1919, 5000)]
)
def test_frames_of_real_sensors_keep_all_sixteen_bits(shared, name, largest, zeros, units):
    raw = read_depth(shared / "samples/kinect" / name, shape=(480, 640))
    assert (raw.dtype, raw.shape, raw.max()) == (np.uint16, (480, 640), largest)
    assert abs((raw == 0).mean() - zeros) < 1e-4
    depth = metres(raw, units_per_metre=units)
    assert depth.dtype == np.float32
    assert (np.isnan(depth) == (raw == 0)).all()
    np.testing.assert_allclose(np.nanmax(depth), largest / units, rtol=1e-6)


def test_written_frames_read_back_without_loss_and_with_the_same_bytes(tmp_path):
    extremes = frame()
    extremes[0, :4] = 0, 1, 65534, 65535
    for file in (tmp_path / "1.png", tmp_path / "2.png"):
        write_depth(file, extremes)
    np.testing.assert_array_equal(read_depth(tmp_path / "1.png", shape=SHAPE), extremes)
    assert (tmp_path / "1.png").read_bytes() == (tmp_path / "2.png").read_bytes()


def test_images_that_are_no_depth_are_refused(tmp_path):
    file = tmp_path / "d.png"
    for image, words in [
        (np.zeros(SHAPE, np.uint8), "1 channel(s) of 8 bits"),
        (np.zeros((*SHAPE, 3), np.uint8), "3 channel(s) of 8 bits"),
        (np.zeros((*SHAPE, 3), np.uint16), "3 channel(s) of 16 bits"),
        (np.zeros((480, 640), np.uint16), "640 × 480 pixels where the camera has 512 × 424"),
    ]:
        file.write_bytes(cv2.imencode(".png", image)[1].tobytes())
        assert words in refused(read_depth, file, shape=SHAPE).message
    file.write_bytes(cv2.imencode(".tiff", frame())[1].tobytes())
    assert "no PNG" in refused(read_depth, file, shape=SHAPE).message
    file.write_text("no image at all\n")
    assert "no PNG" in refused(read_depth, file, shape=SHAPE).message
    refused(read_depth, tmp_path / "absent.png", shape=SHAPE)
    with pytest.raises(TypeError):
        write_depth(file, frame().astype(np.int32))


def test_frames_cut_anywhere_or_with_a_flipped_byte_are_refused(tmp_path):
    file, shape = tmp_path / "d.png", (12, 16)
    write_depth(file, frame(shape=shape))
    content = file.read_bytes()
    for cut in range(0, len(content) - 4, 7):  # the last four bytes check a chunk without content
        file.write_bytes(content[:cut])
        refused(read_depth, file, shape=shape)
    for place in range(len(content) // 4, len(content) * 3 // 4, 20):
        file.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        refused(read_depth, file, shape=shape)


def test_a_frame_is_read_and_written_within_tens_of_milliseconds(tmp_path):
    raw, spent = frame(), []
    for _ in range(5):
        start = time.perf_counter()
        write_depth(tmp_path / "d.png", raw)
        middle = time.perf_counter()
        metres(read_depth(tmp_path / "d.png", shape=SHAPE), units_per_metre=1000)
        spent.append((middle - start, time.perf_counter() - middle))
    assert np.min(spent, axis=0).max() < 0.02


# --- index


def test_written_indexes_read_back(tmp_path):
    stamps, files = 1305031102.175304 + np.arange(5) / 30, tuple(f"depth/{n:04d}.png" for n in range(5))
    write_index(tmp_path / "depth.txt", stamps, files)
    found = read_index(tmp_path / "depth.txt")
    np.testing.assert_allclose(found.time, stamps, rtol=0, atol=0.6e-6)
    assert (found.files, found.counts) == (files, {"cut_rows": 0})


def test_blanks_and_comments_in_an_index_are_no_matter(tmp_path):
    (tmp_path / "depth.txt").write_text("# depth maps\n\n0.5  depth/a.png \n \n0.6\tdepth/b c.png\n# end\n")
    found = read_index(tmp_path / "depth.txt")
    assert (found.time.tolist(), found.files) == ([0.5, 0.6], ("depth/a.png", "depth/b c.png"))


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("0.5 a\n0.5 b\n", 2),
        ("0.5 a\n\nnan b\n", 3),
        ("0.5\n", 1),
        ("a.png 0.5\n", 1),
        ("# nothing\n", None),
        ("", None),
        ("0.5 a", None),
    ],
)
def test_indexes_without_time_or_frame_are_refused(tmp_path, content, line):
    (tmp_path / "depth.txt").write_text(content)
    assert refused(read_index, tmp_path / "depth.txt").evidence.get("line") == line


def test_an_index_cut_at_any_byte_names_only_whole_files(tmp_path):
    file = tmp_path / "depth.txt"
    write_index(file, np.arange(3) / 30, ("a.png", "b.png", "c.png"))
    content = file.read_bytes()
    for cut in range(len(content)):
        file.write_bytes(content[:cut])
        kept = content[:cut].count(b".png\n")
        if kept:
            assert read_index(file).files == ("a.png", "b.png", "c.png")[:kept]
        else:
            refused(read_index, file)


# --- intrinsics


def test_the_intrinsics_of_a_real_kinect_are_read_from_yaml_1_0(shared):
    found = read_intrinsics(shared / "samples/kinect/kinect2_ir_intrinsics.yaml", width=512, height=424)
    assert (found.fx, found.fy) == (366.94757270064110, 364.79117165721783)
    assert (found.cx, found.cy) == (242.98551682775121, 207.69853575457685)
    k1, k2, p1, p2, k3 = found.distortion
    assert (k1, k2, k3) == (0.096558110377123016, -0.28298244017989416, 0.10523948765859192)
    assert (p1, p2) == (1.5889951609432634e-04, -5.0751483524871712e-04)


def test_written_intrinsics_read_back_exactly_in_the_sensors_own_format(tmp_path):
    original = Intrinsics(365.456, 365.1, 254.878, 205.395, 512, 424, (0.1, -0.2, 1e-4, -1 / 3, 0.5))
    write_intrinsics(tmp_path / "ir.yaml", original)
    assert (tmp_path / "ir.yaml").read_text().startswith("%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n")
    assert read_intrinsics(tmp_path / "ir.yaml", width=512, height=424) == original
    write_intrinsics(tmp_path / "ir.yaml", Intrinsics(1.5, 1, 2, 3, 4, 5))
    assert read_intrinsics(tmp_path / "ir.yaml", width=4, height=5).distortion == (0,) * 5


def test_calibrations_that_are_none_are_refused(tmp_path):
    file = tmp_path / "ir.yaml"
    write_intrinsics(file, Intrinsics(365.5, 365.25, 254.5, 205.5, 512, 424))
    good = file.read_text()
    for old, new, words in [
        ("365.5", "-1.", "[fx 0 cx; 0 fy cy; 0 0 1]"),
        ("365.5", ".Nan", "[fx 0 cx; 0 fy cy; 0 0 1]"),
        ("254.5", "600.", "outside 512 × 424"),
        ("cameraMatrix", "camera", "no 3 × 3 cameraMatrix"),
        ("distortionCoefficients", "distortion", "no distortionCoefficients"),
        ("rows: 3", "rows: 4", "OpenCV's YAML"),
        (good, "cameraMatrix: 5\n", "OpenCV's YAML"),
        (good, "%YAML:1.0\n---\ncameraMatrix: 5\n", "OpenCV's YAML"),
    ]:
        assert old in good
        file.write_text(good.replace(old, new, 1))
        assert words in refused(read_intrinsics, file, width=512, height=424).message
    refused(read_intrinsics, tmp_path / "absent.yaml", width=512, height=424)


def test_a_calibration_cut_at_any_byte_is_refused_or_whole(tmp_path):
    file, original = tmp_path / "ir.yaml", Intrinsics(365.456, 365.123, 254.878, 205.395, 512, 424, (0.125,) * 5)
    write_intrinsics(file, original)
    content = file.read_bytes()
    for cut in range(len(content)):
        file.write_bytes(content[:cut])
        try:
            assert read_intrinsics(file, width=512, height=424) == original
        except RecordingError:
            pass
