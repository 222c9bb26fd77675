"""YAML as the project reads it: numbers as OmegaConf has them, and what is ambiguous or no YAML
refused with its file.
"""

from __future__ import annotations

from itertools import pairwise

import pytest
from omegaconf import OmegaConf

from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import load_yaml, read_yaml


def test_values_are_those_that_omegaconf_reads(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text(
        "a: 1e-3\nb: 2024-01-01\nc: [1, 0x10, 1_000, .5, yes, ~, 'ü']\nd: {e: 1.0e+5, f: '${a}', "
        "g: 12:30}\n",
        encoding="utf-8",
    )
    assert load_yaml(file) == OmegaConf.load(file)
    assert read_yaml(file) == OmegaConf.to_container(OmegaConf.load(file))
    assert read_yaml(file)["a"] == 0.001 and read_yaml(file)["d"]["f"] == "${a}"


def test_an_empty_file_holds_nothing(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text("# nothing yet\n")
    assert read_yaml(file) == {} and load_yaml(file) == {}


@pytest.mark.parametrize(
    "content",
    [
        b"a: 1\na: 2\n",
        b"a: [1, 2\n",
        b"- 1\n- 2\n",
        b"text",
        b"a: \xff\n",
        b"a: !!python/object:os.system x\n",
    ],
)
def test_what_is_ambiguous_or_holds_no_keys_is_refused_with_its_file(tmp_path, content):
    file = tmp_path / "a.yaml"
    file.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        load_yaml(file)
    assert caught.value.evidence["file"] == file


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("a: " + "[" * 51 + "]" * 51, "deeper than 50"),
        ("a: " + "[" * 60_000, "deeper than 50"),
        ("".join(" " * level + "a:\n" for level in range(60)), "deeper than 50"),
        ("a:\n " + "- " * 60_000 + "x", "deeper than 50"),
        ("a: &a\n  b: [*a]\n", "stands in what it refers to"),
        (
            "a: &a [1]\n"
            + "".join(
                f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in pairwise("abcdefghijk")
            ),
            "more than 200000 values",
        ),
    ],
)
def test_what_would_take_the_process_or_its_memory_along_is_refused(tmp_path, content, words):
    file = tmp_path / "a.yaml"
    file.write_text(content)
    with pytest.raises(ConfigError, match=words):
        read_yaml(file)


def test_a_reference_and_a_depth_within_the_bounds_are_read(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text("a: &a [1, 2]\nb: [*a, *a]\nc: " + "[" * 49 + "]" * 49)
    assert read_yaml(file)["b"] == [[1, 2], [1, 2]]
