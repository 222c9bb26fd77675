"""Source files of the pipeline, what they import, and hashes of them."""

import hashlib
import os
import re
from collections.abc import Iterable
from pathlib import Path

SOURCES = Path(__file__).parents[1]
STATEMENT = r"(?:from|import) (pipeline[\w.]*)(?: import (\([^)]*\)|.*))?"
AT_IMPORT, ANYWHERE = (
    re.compile(rf"^{indent}{STATEMENT}", re.M) for indent in ("", r"[ \t]*")
)


def module_files() -> dict[str, Path]:
    """Return the files of all modules of the pipeline by name, sorted."""
    files = []
    # os.walk, unlike glob, accepts that another process removes a cache meanwhile
    for place, _, names in os.walk(SOURCES):
        files += [Path(place, name) for name in names if name.endswith(".py")]
    modules = {}
    for file in sorted(files):
        parts = ("pipeline", *file.relative_to(SOURCES).with_suffix("").parts)
        modules[".".join(parts).removesuffix(".__init__")] = file
    return modules


def imported_sources(
    modules: Iterable[str],
    statements: re.Pattern = AT_IMPORT,
) -> list[Path]:
    """Return the files of ``modules`` and of all modules that they import, by ``statements`` at the
    top of a module or ANYWHERE, sorted.
    """
    files = module_files()
    visited = set()
    waiting = [*modules]
    while waiting:
        name = waiting.pop()
        visited.add(name)
        text = files[name].read_text(encoding="utf-8")
        for module, names in statements.findall(text):
            members = {f"{module}.{member}" for member in re.findall(r"\w+", names)}
            imported = (members & files.keys()) or ({module} & files.keys())
            waiting += imported - visited
    return sorted(files[name] for name in visited)


def sources_hash(files: Iterable[Path] | None = None) -> str:
    """Return the hash of the paths and contents of ``files`` (default: all of the pipeline)."""
    digest = hashlib.sha256()
    for file in module_files().values() if files is None else files:
        digest.update(f"{file.relative_to(SOURCES)}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:16]
