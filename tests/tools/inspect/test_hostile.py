"""Hostile folders and files: nothing gets out of hand, and nothing but a finding comes of them."""

from __future__ import annotations

import json
import os
import time
import zlib
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motive_files import rows_file

from pipeline.core.errors import RecordingError
from pipeline.tools.inspect import limits
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.report import as_json, as_table


def test_pipes_and_dangling_or_circular_links_are_named_and_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "gone.csv").symlink_to("nowhere")
    (tmp_path / "round").symlink_to(tmp_path)
    findings = inspect(tmp_path)
    assert {finding.file.name: finding.stops for finding in findings} == {
        name: ["this is no regular file, or a link to nothing"] for name in ("pipe.csv", "gone.csv")
    }


def test_a_name_that_is_no_utf8_can_be_printed(tmp_path):
    (tmp_path / os.fsdecode(b"take\xff.csv")).write_text("1;2\n3;4\n")
    findings = inspect(tmp_path)
    for text in (as_table(findings, tmp_path), as_json(findings)):
        assert "take\\" in text and text.encode()


def test_names_that_a_terminal_would_act_on_are_not_printed(tmp_path):
    rows_file(
        tmp_path,
        "rigidbody,Ha\x1b[2Jnd,1,0",
        *(f"frame,{k},{k / 100:.6f},1,1,{k},0,1,0,0,0,1,0,0,0,0" for k in range(9)),
    )
    findings = inspect(tmp_path)
    assert findings[0].bodies == ["Ha\x1b[2Jnd"] and "Ha\N{REPLACEMENT CHARACTER}[2Jnd" in as_table(
        findings, tmp_path
    )


def test_nothing_that_would_execute_is_executed(zoo, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inspect(zoo)
    assert list(tmp_path.iterdir()) == []


def test_a_picture_that_unfolds_into_gigabytes_is_refused_by_its_header(zoo, tmp_path):
    content = bytearray((zoo / "single.png").read_bytes())
    content[16:24] = (10_000).to_bytes(4, "big") * 2
    content[29:33] = zlib.crc32(content[12:29]).to_bytes(4, "big")
    (tmp_path / "bomb.png").write_bytes(content)
    (finding,) = inspect(tmp_path)
    assert "more than any depth camera" in finding.stops[0]


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [x, x]\n"
        + "".join(f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in pairwise("abcdefghijklmnop")),
        "[" * 5000,
    ],
)
def test_yaml_that_unfolds_or_nests_without_end_is_refused(tmp_path, monkeypatch, text):
    monkeypatch.setattr(limits, "PATIENCE", 1.0)
    (tmp_path / "dataset.yaml").write_text(f"recordings: x\n{text}\n")
    began = time.monotonic()
    (finding,) = inspect(tmp_path)
    assert finding.stops and time.monotonic() - began < 5


def test_time_and_memory_of_one_file_are_bounded():
    with pytest.raises(RecordingError, match=r"within 0\.1 s"), limits.bounded(patience=0.1):
        while True:
            pass
    with pytest.raises(RecordingError, match="memory"), limits.bounded(memory=1 << 32):
        np.ones(1 << 32)
    with limits.bounded():
        pass
    np.ones(1 << 20)


def test_a_folder_of_more_files_than_recordings_have_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.tools.inspect.examine.MAX_FILES", 3)
    for number in range(5):
        (tmp_path / f"{number}.txt").write_text("x")
    with pytest.raises(RecordingError, match="more than 3 files"):
        inspect(tmp_path)


def test_a_place_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="no such file or folder"):
        inspect(tmp_path / "nothing")


DAMAGED = (
    *("columns.csv", "rows.csv", "points.csv", "commas.csv", "netft.csv", "FT7.cal", "single.png"),
    *("metres.tiff", "camera.yaml", "sized.json", "cloud.ply", "cloud.pcd", "q.csv", "path.csv"),
    *("three.urdf", "dataset.yaml", "payload.pkl"),
)


@pytest.mark.parametrize("name", DAMAGED)
@settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_damage_anywhere_is_told_and_never_raised(zoo, tmp_path, name, data):
    content = bytearray((zoo / name).read_bytes())
    cut = data.draw(st.integers(0, len(content)))
    place = data.draw(st.integers(0, len(content) - 1))
    content[place : place + 4] = data.draw(st.binary(min_size=0, max_size=6))
    (tmp_path / name).write_bytes(content[:cut])
    (finding,) = inspect(tmp_path / name)
    json.loads(as_json([finding]))
    as_table([finding], tmp_path)


@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    content=st.binary(max_size=400),
    suffix=st.sampled_from(
        ["csv", "c3d", "png", "pcd", "ply", "bag", "db3", "mcap", "yaml", "urdf", "txt"]
    ),
)
def test_bytes_of_any_kind_are_told_and_never_raised(tmp_path, content, suffix):
    (tmp_path / f"a.{suffix}").write_bytes(content)
    (finding,) = inspect(tmp_path / f"a.{suffix}")
    assert finding.file.name == f"a.{suffix}"
