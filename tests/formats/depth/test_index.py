"""Frames of a depth sequence and their times: by the index of TUM, by numbered names."""

from __future__ import annotations

import numpy as np
import pytest
from written_logs import refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.index import dropped_frames, numbered_frames, read_index, write_index


def test_written_indexes_read_back(tmp_path):
    stamps = 1305031102.175304 + np.arange(5) / 30
    files = tuple(f"depth/{n:04d}.png" for n in range(5))
    write_index(tmp_path / "depth.txt", stamps, files)
    result = read_index(tmp_path / "depth.txt")
    np.testing.assert_allclose(result.time, stamps, rtol=0, atol=0.6e-6)
    assert (result.files, result.counts) == (files, {"cut_rows": 0})


def test_blanks_comments_and_the_line_ends_of_tums_lists_are_no_matter(tmp_path):
    (tmp_path / "depth.txt").write_bytes(
        b"# depth maps\r\n\n0.160407  depth/a.png  \r\n \n0.6\tdepth/b c.png\n# end\n"
    )
    result = read_index(tmp_path / "depth.txt")
    assert result.time.tolist() == [0.160407, 0.6]
    assert result.files == ("depth/a.png", "depth/b c.png")


@pytest.mark.parametrize("units", [1e3, 1e6, 1e9], ids=["ms", "us", "ns"])
def test_times_in_another_unit_than_seconds_are_refused(tmp_path, units):
    file = tmp_path / "depth.txt"
    write_index(file, 1305031102.0 + np.arange(5) / 30, tuple(f"{n}.png" for n in range(5)))
    assert len(read_index(file).time) == 5
    lines = [f"{(1305031102.0 + n / 30) * units:.0f} {n}.png\n" for n in range(5)]
    file.write_text("".join(lines))
    assert "write the times in s" in refusal(read_index, file).message


def numbered(folder, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(b"")


def test_numbered_frames_are_seen_at_the_rate_and_missing_numbers_leave_their_time_out(tmp_path):
    names = tuple(f"depth/frame2-{n}.depth.png" for n in (9, 10, 11, 13, 100))
    numbered(tmp_path, *names, "depth/colour-1.jpg")
    result = numbered_frames(tmp_path, "depth/*.png", rate=30.0)
    assert result.files == names
    np.testing.assert_allclose(result.time, np.array([0, 1, 2, 4, 91]) / 30)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["a.png", "b.png"], "no number"),
        (["7.png", "007.png"], "twice"),
        (["1305031102.175304.png", "1305031103.205304.png"], "differ in more than a number"),
        (["left1.png", "right1.png"], "differ in more than a number"),
        ([], "no depth frame matches"),
    ],
)
def test_names_whose_number_is_not_plain_are_refused(tmp_path, names, words):
    numbered(tmp_path, *names)
    with pytest.raises(RecordingError, match=words):
        numbered_frames(tmp_path, "*.png", rate=30.0)


def test_dropped_frames_are_counted_by_the_indexs_own_times():
    rng = np.random.default_rng(1)
    time = np.arange(97) / 30 + rng.normal(scale=2e-3, size=97)
    assert dropped_frames(time) == 0  # at whatever rate the datasheet states
    assert dropped_frames(np.delete(time, [5, 40, 41])) == 3
    assert dropped_frames(time[:1]) == 0
