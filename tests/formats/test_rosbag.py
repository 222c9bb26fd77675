"""Bags of both ROS versions: their topics, their messages, and what is refused of them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ros_bags import image, write_bag

from pipeline.core.bounds import Reading, within
from pipeline.core.errors import RecordingError
from pipeline.formats.format import is_bag
from pipeline.formats.rosbag import choose_topic, messages, seconds, topics

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
PIXELS = np.arange(12, dtype=np.uint16).reshape(3, 4)
FORMS = ("ros1", "ros1_lz4", "sqlite3", "mcap", "zstd")


def first(message: object) -> tuple[float, int]:
    return seconds(message), int(message.data.view("<u2")[0])


def content(message: object) -> bytes:
    return bytes(message.data)


def recorded(folder: Path, form: str, count: int = 5) -> Path:
    depth = [
        (1700000000.0 + 0.04 * i, image(PIXELS + i, 1700000000.0 + 0.04 * i)) for i in range(count)
    ]
    colour = [(stamp + 0.001, image(PIXELS, stamp)) for stamp, _ in depth]
    return write_bag(
        folder, form, {"/depth": depth, "/colour": colour, "/empty": []}, kinds={"/empty": IMAGE}
    )


@pytest.mark.parametrize("form", FORMS)
def test_messages_come_in_order_with_the_time_of_their_headers(tmp_path, form):
    bag = recorded(tmp_path, form)
    assert is_bag(bag)
    assert topics(bag) == {"/depth": IMAGE, "/colour": IMAGE}
    result = list(messages(bag, "/depth", first))
    np.testing.assert_allclose(
        [stamp for stamp, _ in result],
        1700000000.0 + 0.04 * np.arange(5),
        rtol=0,
        atol=1e-6,
    )
    assert [pixel for _, pixel in result] == list(range(5))


def test_a_topic_is_the_only_one_or_the_chosen_one(tmp_path):
    bag = recorded(tmp_path, "ros1")
    assert choose_topic(bag, (IMAGE,), "/depth") == "/depth"
    for kinds, chosen in [
        ((IMAGE,), None),
        ((INFO,), None),
        ((IMAGE,), "/elsewhere"),
        ((INFO,), "/depth"),
    ]:
        with pytest.raises(
            RecordingError, match=r"there are /colour \(Image\), /depth \(Image\)"
        ) as refused:
            choose_topic(bag, kinds, chosen)
        assert refused.value.evidence["file"] == bag
    with pytest.raises(RecordingError, match="no topic '/else'"):
        next(messages(bag, "/else", first))


def test_messages_without_time_are_refused():
    with pytest.raises(RecordingError, match="no time"):
        seconds(image(PIXELS, 0.0).for_version("ros1"), file="take.bag")
    assert seconds(image(PIXELS, 12.5).for_version("ros2")) == 12.5
    with pytest.raises(RecordingError, match="no time"):
        seconds(object())


def test_files_that_are_no_bags_are_refused(tmp_path):
    (tmp_path / "empty.bag").write_bytes(b"")
    (tmp_path / "text.bag").write_text("no bag\n")
    (tmp_path / "text.mcap").write_text("no bag\n")
    (tmp_path / "text.db3").write_text("no bag\n")
    for name, content in (
        ("folder", "a: 1\n"),
        ("list", "- 1\n"),
        ("broken", "a: [\n"),
        ("none", ""),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").write_text(content)
    for bag in [*tmp_path.iterdir(), tmp_path / "absent.bag"]:
        with pytest.raises(RecordingError) as refused:
            topics(bag)
        assert refused.value.evidence["file"] == bag
    assert not is_bag(tmp_path / "absent.bag")
    assert not is_bag(tmp_path)


def read_all(bag: Path) -> list[bytes]:
    return [*messages(bag, "/depth", content)]


@pytest.mark.parametrize("form", ["ros1_bz2", "ros1_lz4", "mcap_zstd", "zstd", "zstd_file"])
def test_compressed_bags_are_read_as_others(tmp_path, form):
    bag = recorded(tmp_path, form)
    assert [pixel for _, pixel in messages(bag, "/depth", first)] == list(range(5))


def test_a_bag_that_takes_more_memory_than_the_bound_is_refused_in_the_sandbox(tmp_path):
    zeros = np.zeros((4000, 8000), np.uint16)
    bag = write_bag(tmp_path, "ros1_bz2", {"/depth": [(1.0, image(zeros, 1.0))]})
    with pytest.raises(RecordingError, match=r"memory|damaged") as refused:
        within(Reading(memory_mib=60), lambda: read_all(bag))
    assert refused.value.evidence["file"] == bag


def test_a_bag_that_lost_a_message_is_refused(tmp_path):
    bag = recorded(tmp_path, "sqlite3")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    assert text.count("message_count: 5") == 2
    metadata.write_text(text.replace("message_count: 5", "message_count: 6"))
    with pytest.raises(RecordingError, match="5 messages where the bag announces 6"):
        list(messages(bag, "/depth", first))


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, tuple[Path, Path, Path]]:
    """A bag of each form, the file that its messages are in, and a copy of that."""
    result = {}
    for form in FORMS:
        bag = recorded(tmp_path_factory.mktemp(form), form, 3)
        file = (
            bag
            if bag.is_file()
            else next(path for path in bag.iterdir() if path.name != "metadata.yaml")
        )
        copy = tmp_path_factory.mktemp("whole") / form
        copy.write_bytes(file.read_bytes())
        result[form] = (bag, file, copy)
    return result


@settings(max_examples=15, deadline=None)
@given(st.data())
@pytest.mark.parametrize("form", FORMS)
def test_a_bag_cut_at_any_byte_is_refused_or_whole(whole, form, data):
    bag, file, copy = whole[form]
    whole_bytes = copy.read_bytes()
    file.write_bytes(whole_bytes)
    before = read_all(bag)
    file.write_bytes(whole_bytes[: data.draw(st.integers(0, len(whole_bytes) - 1))])
    try:
        assert read_all(bag) == before
    except RecordingError as error:
        assert error.evidence["file"] == bag


def test_a_bag_that_does_not_say_how_many_messages_it_holds_is_refused(tmp_path):
    bag = recorded(tmp_path, "sqlite3")
    metadata = bag / "metadata.yaml"
    metadata.write_text(re.sub(r"message_count: \d+", "message_count:", metadata.read_text()))
    with pytest.raises(RecordingError, match="how many messages"):
        topics(bag)
