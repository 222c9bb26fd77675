"""YAML files of keys and values, read with libyaml; duplicate keys are errors."""

import re
from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from pipeline.core.errors import ConfigError


class Loader(yaml.CSafeLoader):
    """YAML 1.1 without dates, with numbers such as 1e-3, which PyYAML reads as text."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        """Return the mapping; raises YAMLError where a key occurs twice."""
        scalars = [k for k, _ in node.value if isinstance(k, yaml.ScalarNode)]
        numbers = Counter(key.value for key in scalars)
        twice = [key for key, number in numbers.items() if number > 1]
        if twice:
            where = node.start_mark.line + 1
            raise yaml.YAMLError(
                f"key {min(twice)!r} occurs twice in the mapping of line {where}",
            )
        return super().construct_mapping(node, deep)


Loader.yaml_implicit_resolvers = {
    first: [
        (tag, pattern) for tag, pattern in resolvers if not tag.endswith(":timestamp")
    ]
    for first, resolvers in yaml.CSafeLoader.yaml_implicit_resolvers.items()
}
# levels of nesting: option files have up to 8, and libyaml ends the process at some ten thousand
MOST_DEEP = 100
FLOAT = re.compile(r"[-+]?\d[\d_]*(\.[\d_]*)?[eE][-+]?\d+$")
Loader.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+0123456789"))


def _require_finite(text: str | bytes) -> None:
    """Raise YAMLError for more than MOST_DEEP levels, and for an alias in what it stands for."""
    anchors = []  # of the mappings and lists that are open
    for event in yaml.parse(text, yaml.CSafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            anchors.append(event.anchor)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchors.pop()
        elif isinstance(event, yaml.AliasEvent) and event.anchor in anchors:
            where = event.start_mark.line + 1
            message = (
                f"alias *{event.anchor} in line {where} stands for what contains it"
            )
            raise yaml.YAMLError(f"{message}: write the values out")
        if len(anchors) > MOST_DEEP:
            where = event.start_mark.line + 1
            raise yaml.YAMLError(
                f"line {where} nests more than {MOST_DEEP} levels deep",
            )


def read_yaml(file: Path) -> dict[str, Any]:
    """Return keys and values of ``file``, {} if it is empty; raises ConfigError otherwise."""
    try:
        content = Path(file).read_bytes()
    except OSError as error:
        message = f"cannot be read ({error.strerror}); run the pipeline from the project's root"
        raise ConfigError(message, file=file) from None
    loaded = parse_yaml(content, file=file)
    if not isinstance(loaded, dict | None):
        raise ConfigError("must contain keys and values", file=file)
    return loaded or {}


def parse_yaml(text: str | bytes, **evidence: object) -> Any:
    """Return the value of ``text``; raises ConfigError with ``evidence`` where it is not YAML."""
    try:
        _require_finite(text)
        return yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        message = f"cannot be read as YAML: {' '.join(str(error).split())}"
        raise ConfigError(message, **evidence) from None
