"""Depth images of every format that recorders write, what their values mean, and what is
refused.
"""

from __future__ import annotations

import io
import struct
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest
from depth_files import SHAPE, frame
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.encoding import Encoding, metres
from pipeline.formats.depth.image import RawDepth, read_depth
from pipeline.formats.depth.png import write_depth


def refused(call, *arguments, **keywords) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        call(*arguments, **keywords)
    assert caught.value.evidence["file"] == arguments[0]
    return caught.value


@pytest.mark.parametrize(
    ("name", "largest", "zeros", "units"),
    [
        ("depth_millimetres.png", 2702, 0.1304, 1000),
        ("depth_tum_scale5000.png", 46655, 0.1919, 5000),
    ],
)
def test_frames_of_real_sensors_keep_all_sixteen_bits(shared, name, largest, zeros, units):
    raw = read_depth(shared / "samples/kinect" / name, shape=(480, 640)).pixels
    assert (raw.dtype, raw.shape, raw.max()) == (np.uint16, (480, 640), largest)
    assert abs((raw == 0).mean() - zeros) < 1e-4
    depth = metres(RawDepth(raw), Encoding("plain", units))
    assert depth.dtype == np.float32
    assert (np.isnan(depth) == (raw == 0)).all()
    np.testing.assert_allclose(np.nanmax(depth), largest / units, rtol=1e-6)


def test_written_frames_read_back_without_loss_and_with_the_same_bytes(tmp_path):
    extremes = frame()
    extremes[0, :4] = 0, 1, 65534, 65535
    for file in (tmp_path / "1.png", tmp_path / "2.png"):
        write_depth(file, extremes)
    np.testing.assert_array_equal(read_depth(tmp_path / "1.png", shape=SHAPE).pixels, extremes)
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
    file.write_bytes(cv2.imencode(".tiff", np.zeros(SHAPE, np.int16))[1].tobytes())
    assert "1 signed channel(s) of 16 bits" in refused(read_depth, file, shape=SHAPE).message
    file.write_text("no image at all\n")
    assert "no PNG" in refused(read_depth, file, shape=SHAPE).message
    refused(read_depth, tmp_path / "absent.png", shape=SHAPE)
    with pytest.raises(TypeError):
        write_depth(file, frame().astype(np.int32))


def test_frames_cut_anywhere_or_with_a_flipped_byte_are_refused(tmp_path):
    file, shape = tmp_path / "d.png", (12, 16)
    write_depth(file, frame(shape=shape))
    content = file.read_bytes()
    for cut in range(0, len(content), 7):
        file.write_bytes(content[:cut])
        refused(read_depth, file, shape=shape)
    for place in range(len(content) // 4, len(content) * 3 // 4, 20):
        file.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        refused(read_depth, file, shape=shape)


def tiff(image: np.ndarray, description: str = "", **options: object) -> bytes:
    content = io.BytesIO()
    Image.fromarray(image).save(content, "TIFF", description=description, **options)
    return content.getvalue()


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_adobe_deflate"])
@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_tiffs_keep_their_values_and_their_description(tmp_path, kind, compression):
    image = (frame() / np.float32(1)).astype(kind)
    (tmp_path / "d.tif").write_bytes(
        tiff(
            image,
            "depth scale=0.25 of a sensor",
            **({"compression": compression} if compression else {}),
        )
    )
    raw = read_depth(tmp_path / "d.tif", shape=SHAPE)
    assert raw.pixels.dtype == kind
    np.testing.assert_array_equal(raw.pixels, image)
    assert raw.description == "depth scale=0.25 of a sensor"
    depth = metres(raw, Encoding("plain", 1000, scale_key="scale"))
    np.testing.assert_allclose(depth[image > 0], image[image > 0] * 0.25e-3, rtol=1e-6)


def test_a_tiff_of_float64_is_rounded_to_float32_and_its_size_is_known_before_it_is_decoded(
    tmp_path,
):
    image = frame() / 3.0
    content = cv2.imencode(".tif", image)[1].tobytes()
    (tmp_path / "d.tif").write_bytes(content)
    pixels = read_depth(tmp_path / "d.tif", shape=SHAPE).pixels
    assert pixels.dtype == np.float32
    np.testing.assert_array_equal(pixels, image.astype(np.float32))
    assert (
        "pixels where the camera has"
        in refused(read_depth, tmp_path / "d.tif", shape=(SHAPE[0], SHAPE[1] + 1)).message
    )
    for end in range(0, len(content), len(content) // 40):
        (tmp_path / "d.tif").write_bytes(content[:end])
        refused(read_depth, tmp_path / "d.tif", shape=SHAPE)


def test_pgm_images_are_read_in_their_own_byte_order(tmp_path):
    image = frame()
    (tmp_path / "d.pgm").write_bytes(
        b"P5\n# a comment\n512 424\n65535\n" + image.astype(">u2").tobytes()
    )
    np.testing.assert_array_equal(read_depth(tmp_path / "d.pgm", shape=SHAPE).pixels, image)


@pytest.mark.parametrize(
    ("change", "words"),
    [(-1, "1 bytes lack"), (-300, "300 bytes lack"), (1, "1 bytes are left"), (9, "9 bytes are")],
)
def test_a_pgm_with_other_than_its_pixels_is_refused_with_the_bytes_counted(
    tmp_path, change, words
):
    content = CONTENTS["pgm"] + bytes(9)
    file = tmp_path / "d.pgm"
    file.write_bytes(content[: len(content) - 9 + change])
    assert words in refused(read_depth, file, shape=SMALL.shape).message


def bomb(width: int, height: int) -> bytes:
    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(2 * width + 1), 9)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("side", [12_000, 60_000, 2**31 - 1])
def test_an_image_that_would_unfold_into_gigabytes_is_refused_before_it_does(tmp_path, side):
    file = tmp_path / "d.png"
    file.write_bytes(bomb(min(side, 60_000), side))
    tracemalloc.start()
    refused(read_depth, file, shape=SHAPE)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_a_file_of_several_images_is_refused(tmp_path):
    (tmp_path / "d.tif").write_bytes(
        tiff(frame(), save_all=True, append_images=[Image.fromarray(frame(2))])
    )
    assert "2 images" in refused(read_depth, tmp_path / "d.tif", shape=SHAPE).message


SMALL = frame(shape=(12, 16))


CONTENTS = {
    "png": cv2.imencode(".png", SMALL)[1].tobytes(),
    "tif": tiff(SMALL, "scale=1"),
    "lzw": tiff(SMALL, "scale=1", compression="tiff_lzw"),
    "pgm": b"P5\n16 12\n65535\n" + SMALL.astype(">u2").tobytes(),
}


@settings(max_examples=25, deadline=None)
@given(st.data())
@pytest.mark.parametrize("kind", CONTENTS)
def test_an_image_cut_at_any_byte_is_refused_or_whole(tmp_path_factory, kind, data):
    file = tmp_path_factory.getbasetemp() / f"cut.{kind}"
    file.write_bytes(CONTENTS[kind][: data.draw(st.integers(0, len(CONTENTS[kind]) - 1))])
    try:
        np.testing.assert_array_equal(read_depth(file, shape=SMALL.shape).pixels, SMALL)
    except RecordingError as error:
        assert error.evidence["file"] == file


@settings(max_examples=40, deadline=None)
@given(st.data())
@pytest.mark.parametrize("kind", CONTENTS)
def test_damaged_bytes_never_raise_anything_but_a_refusal(tmp_path_factory, kind, data):
    file, content = tmp_path_factory.getbasetemp() / f"damaged.{kind}", bytearray(CONTENTS[kind])
    for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=3)):
        content[place] = data.draw(st.integers(0, 255))
    file.write_bytes(content)
    try:
        assert read_depth(file, shape=SMALL.shape).pixels.shape == SMALL.shape
    except RecordingError as error:
        assert error.evidence["file"] == file
