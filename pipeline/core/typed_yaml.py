"""YAML files of keys and values, read with libyaml; a key that occurs twice is refused."""

import re
from pathlib import Path
from typing import Any

import yaml

from pipeline.core.errors import ConfigError


class Loader(yaml.CSafeLoader):
    """YAML 1.1 with numbers as 1e-3, which PyYAML takes for text, and without dates."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        """Return the mapping; YAMLError where a key occurs twice."""
        keys = [key.value for key, _ in node.value]
        if twice := sorted({key for key in keys if keys.count(key) > 1}):
            where = node.start_mark.line + 1
            raise yaml.YAMLError(f"key {twice[0]!r} occurs twice in the mapping of line {where}")
        return super().construct_mapping(node, deep)


Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith(":timestamp")]
    for first, resolvers in yaml.CSafeLoader.yaml_implicit_resolvers.items()
}
FLOAT = re.compile(r"[-+]?\d[\d_]*(\.[\d_]*)?[eE][-+]?\d+$")
Loader.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+0123456789"))


def read_yaml(file: Path) -> dict[str, Any]:
    """Return keys and values of ``file``, {} if it is empty; ConfigError for any other file."""
    try:
        content = Path(file).read_bytes()
    except FileNotFoundError:
        message = "no such file; run the pipeline from the project's root"
        raise ConfigError(message, file=file) from None
    except OSError as error:
        raise ConfigError(f"cannot be read ({error.strerror})", file=file) from None
    loaded = parsed(content, file=file)
    if not isinstance(loaded, dict | None):
        raise ConfigError("must hold keys and values", file=file)
    return loaded or {}


def parsed(text: str | bytes, **evidence: object) -> Any:
    """Return the value of ``text`` as YAML; ConfigError with ``evidence`` where it is no YAML."""
    try:
        return yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        message = f"cannot be read as YAML: {' '.join(str(error).split())}"
        raise ConfigError(message, **evidence) from None
