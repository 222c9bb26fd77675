"""Values as the text of YAML, and ??? where nobody but the user knows them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path

from pipeline.tools.inspect.finding import Finding, shown

OPEN = "???"  # OmegaConf's mark of a value to come
RESERVED = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")


def several(names: list[str]) -> str:
    """``names`` as a list in YAML has them, without its brackets."""
    return ", ".join(map(text_of, names))


def agreed(values: Iterable[float | None]) -> str:
    """The one value that all recordings state, else ???."""
    stated = set(values)
    return f"{stated.pop():.10g}" if len(stated) == 1 and None not in stated else OPEN


def one_of(choices: Iterable[str]) -> str:
    """???, and between which ``choices`` the user has to choose."""
    listed = ", ".join(choices)
    return f"{OPEN} # one of {listed}" if listed else OPEN


def below_folder(folder: Path, finding: Finding) -> str:
    """The path of a recording below ``folder``."""
    return text_of(shown(finding.file.relative_to(folder)))


def text_of(text: str) -> str:
    """``text`` as YAML, quoted where it could be read as anything else."""
    plain = (
        re.fullmatch(r"[A-Za-z_][\w./*-]*|\.\.?/[\w./*-]*", text, re.ASCII)
        and text.lower() not in RESERVED
    )
    return text if plain else json.dumps(text, ensure_ascii=False)
