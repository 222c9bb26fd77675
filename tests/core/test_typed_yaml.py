"""YAML as the project reads it: numbers as OmegaConf has them, and what is ambiguous or no YAML
refused with its file.
"""

from __future__ import annotations

import pytest
from omegaconf import OmegaConf

from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml


def test_values_are_those_that_omegaconf_reads(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text(
        "a: 1e-3\nb: 2024-01-01\nc: [1, 0x10, 1_000, .5, yes, ~, 'ü']\nd: {e: 1.0e+5, f: '${a}', "
        "g: 12:30}\n",
        encoding="utf-8",
    )
    assert read_yaml(file) == OmegaConf.to_container(OmegaConf.load(file))
    assert read_yaml(file)["a"] == 0.001 and read_yaml(file)["d"]["f"] == "${a}"


def test_an_empty_file_holds_nothing(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text("# nothing yet\n")
    assert read_yaml(file) == {}


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
        read_yaml(file)
    assert caught.value.evidence["file"] == file
