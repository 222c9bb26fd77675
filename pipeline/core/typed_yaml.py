"""YAML files of keys and values, read with libyaml; duplicate keys are errors."""

import re
from pathlib import Path
from typing import Any

import yaml

from pipeline.core.errors import ConfigError


class Loader(yaml.CSafeLoader):
    """YAML 1.1 without dates, with numbers such as 1e-3, which PyYAML reads as text."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        """Return the mapping; raises YAMLError where a key occurs twice."""
        keys = [key.value for key, _ in node.value]
        if twice := sorted({key for key in keys if keys.count(key) > 1}):
            where = node.start_mark.line + 1
            raise yaml.YAMLError(
                f"key {twice[0]!r} occurs twice in the mapping of line {where}"
            )
        return super().construct_mapping(node, deep)


Loader.yaml_implicit_resolvers = {
    first: [
        (tag, pattern) for tag, pattern in resolvers if not tag.endswith(":timestamp")
    ]
    for first, resolvers in yaml.CSafeLoader.yaml_implicit_resolvers.items()
}
FLOAT = re.compile(r"[-+]?\d[\d_]*(\.[\d_]*)?[eE][-+]?\d+$")
Loader.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+0123456789"))


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
        return yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        message = f"cannot be read as YAML: {' '.join(str(error).split())}"
        raise ConfigError(message, **evidence) from None
