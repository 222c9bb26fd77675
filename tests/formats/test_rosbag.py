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
START = 1700000000.0
CUT = ("ros1", "ros1_lz4", "sqlite3", "mcap", "zstd")
FORMS = (*CUT, "ros1_bz2", "mcap_zstd", "zstd_file")


def first(message: object) -> tuple[float, int]:
    return seconds(message), int(message.data.view("<u2")[0])


def recorded(folder: Path, form: str, count: int = 5) -> Path:
    stamps = [START + 0.04 * i for i in range(count)]
    depth = [(stamp, image(PIXELS + i, stamp)) for i, stamp in enumerate(stamps)]
    colour = [(stamp + 0.001, image(PIXELS, stamp)) for stamp in stamps]
    held = {"/depth": depth, "/colour": colour, "/empty": []}
    return write_bag(folder, form, held, kinds={"/empty": IMAGE})


@pytest.mark.parametrize("form", FORMS)
def test_messages_come_in_order_with_the_time_of_their_headers(tmp_path, form):
    bag = recorded(tmp_path, form)
    assert is_bag(bag) and topics(bag) == {"/depth": IMAGE, "/colour": IMAGE}
    stamps, pixels = zip(*messages(bag, "/depth", first), strict=True)
    np.testing.assert_allclose(stamps, START + 0.04 * np.arange(5), rtol=0, atol=1e-6)
    assert pixels == (0, 1, 2, 3, 4)
    assert [pixel for _, pixel in messages(bag, "/depth", first, {1, 3})] == [1, 3]


def test_a_topic_is_the_only_one_or_the_chosen_one(tmp_path):
    bag = recorded(tmp_path, "ros1")
    assert choose_topic(bag, (IMAGE,), "/depth") == "/depth"
    there = r"there are /colour \(Image\), /depth \(Image\)"
    for kind, chosen in ((IMAGE, None), (INFO, None), (IMAGE, "/elsewhere"), (INFO, "/depth")):
        with pytest.raises(RecordingError, match=there) as refused:
            choose_topic(bag, (kind,), chosen)
        assert refused.value.evidence["file"] == bag
    with pytest.raises(RecordingError, match="no topic '/else'"):
        next(messages(bag, "/else", first))


def test_messages_without_time_are_refused():
    assert seconds(image(PIXELS, 12.5).for_version("ros2")) == 12.5
    for message in (image(PIXELS, 0.0).for_version("ros1"), object()):
        with pytest.raises(RecordingError, match="no time"):
            seconds(message, file="take.bag")


def test_files_that_are_no_bags_are_refused(tmp_path):
    for name, text in (("empty.bag", ""), ("a.bag", "no"), ("a.mcap", "no"), ("a.db3", "no")):
        (tmp_path / name).write_text(text)
    for name, text in (("folder", "a: 1\n"), ("list", "- 1\n"), ("broken", "a: [\n"), ("n", "")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").write_text(text)
    for bag in [*tmp_path.iterdir(), tmp_path / "absent.bag"]:
        with pytest.raises(RecordingError) as refused:
            topics(bag)
        assert refused.value.evidence["file"] == bag
    assert not is_bag(tmp_path / "absent.bag") and not is_bag(tmp_path)


def content(message: object) -> bytes:
    return bytes(message.data)


def read_all(bag: Path) -> list[bytes]:
    return [*messages(bag, "/depth", content)]


def test_a_bag_that_takes_more_memory_than_the_bound_is_refused_in_the_sandbox(tmp_path):
    zeros = np.zeros((4000, 8000), np.uint16)
    bag = write_bag(tmp_path, "ros1_bz2", {"/depth": [(1.0, image(zeros, 1.0))]})
    with pytest.raises(RecordingError, match=r"memory|damaged") as refused:
        within(Reading(memory_mib=60), lambda: read_all(bag))
    assert refused.value.evidence["file"] == bag


COUNTS = [(" 6", "5 messages where the bag announces 6")]
COUNTS += [(count, "how many messages") for count in ("", " 1e9")]


@pytest.mark.parametrize(("count", "words"), COUNTS)
def test_a_bag_that_lost_a_message_or_does_not_count_them_is_refused(tmp_path, count, words):
    bag = recorded(tmp_path, "sqlite3")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    assert text.count("message_count: 5") == 2
    metadata.write_text(re.sub(r"message_count: \d+", f"message_count:{count}", text))
    with pytest.raises(RecordingError, match=words):
        read_all(bag)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, tuple[Path, Path, bytes]]:
    """A bag of each form, the file that its messages are in, and the content of that."""
    result = {}
    for form in CUT:
        bag = recorded(tmp_path_factory.mktemp(form), form, 3)
        inside = [bag] if bag.is_file() else [f for f in bag.iterdir() if f.suffix != ".yaml"]
        result[form] = (bag, inside[0], inside[0].read_bytes())
    return result


@settings(max_examples=15, deadline=None)
@given(st.data())
@pytest.mark.parametrize("form", CUT)
def test_a_bag_cut_at_any_byte_is_refused_or_whole(whole, form, data):
    bag, file, sound = whole[form]
    file.write_bytes(sound)
    before = read_all(bag)
    file.write_bytes(sound[: data.draw(st.integers(0, len(sound) - 1))])
    try:
        assert read_all(bag) == before
    except RecordingError as error:
        assert error.evidence["file"] == bag
