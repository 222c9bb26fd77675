"""Damaged files and odd folders: each is a finding, within bounds of size and time."""

from __future__ import annotations

import errno
import json
import os
import signal
import zlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motive_files import rows_file

from pipeline.core.bounds import Reading, within
from pipeline.core.errors import RecordingError
from pipeline.tools.inspect import examine
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
    assert "more than the 64 that are read" in finding.stops[0]


def test_a_folder_of_more_files_than_recordings_have_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.tools.inspect.examine.MAX_FILES", 3)
    for number in range(5):
        (tmp_path / f"{number}.txt").write_text("x")
    with pytest.raises(RecordingError, match="more than 3 files"):
        inspect(tmp_path)


def test_a_file_that_ends_its_reader_is_a_finding_and_the_others_are_read(tmp_path, monkeypatch):
    for name in ("a", "b", "c"):
        (tmp_path / f"{name}.csv").write_text("1;2.5\n3;4.5\n5;6.5\n")
    read = examine.known_as

    def known_as(file: Path):
        if file.name == "b.csv" and os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return read(file)

    here = os.getpid()
    monkeypatch.setattr(examine, "known_as", known_as)
    findings = inspect(tmp_path)
    table = "table of numbers"
    assert [finding.format for finding in findings] == [table, "unknown", table]
    assert findings[1].stops == ["reading it ends the process (exit code -9)"]


def test_a_folder_that_cannot_be_read_is_a_finding(tmp_path, monkeypatch):
    (tmp_path / "closed").mkdir()
    (tmp_path / "a.csv").write_text("1;2.5\n3;4.5\n5;6.5\n")
    scan = os.scandir

    def scandir(place):
        if Path(place).name == "closed":
            raise PermissionError(errno.EACCES, "Permission denied")
        return scan(place)

    monkeypatch.setattr(examine.os, "scandir", scandir)
    stops = {finding.file.name: finding.stops for finding in inspect(tmp_path)}
    assert stops == {"a.csv": [], "closed": ["the folder cannot be read (Permission denied)"]}


def test_a_file_beyond_a_bound_names_it_and_the_bound_can_be_raised(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"1;2.5\n" * 200_000)
    (finding,) = within(Reading(file_mib=1), inspect, tmp_path)
    assert "more than the 1 that are read" in finding.stops[0]
    assert "dataset.reading.file_mib" in finding.stops[0]
    (finding,) = within(Reading(file_mib=2), inspect, tmp_path)
    assert finding.stops == []


def test_a_place_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="no such file or folder"):
        inspect(tmp_path / "nothing")


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
    finding = examine.described(tmp_path / f"a.{suffix}")
    json.loads(as_json([finding]))
    as_table([finding], tmp_path)
    assert finding.file.name == f"a.{suffix}"
