"""Text of the reader beside an exported model: one file that needs only NumPy."""

import ast
from importlib.util import find_spec
from pathlib import Path

from pipeline.models import kinds

HERE = Path(__file__).parent
READER_NAME = "read_motion_model.py"
READER = "pipeline.models.exported.reader"
KINDS = "pipeline.models.kinds"
# module → module whose text is in the reader in its place
STAND_INS = {"pipeline.core.compiled": "pipeline.core.interpreted"}


def reader_source() -> str:
    """Return the text of READER_NAME: reader.txt with the project's reader, its laws and the
    modules that they import, each of which stays a module with names of its own.
    """
    laws = {kind: f"pipeline.models.{kind}.law" for kind in kinds.kinds()}
    texts = {KINDS: _kinds_source(laws)}
    waiting = [*laws.values(), READER]
    while waiting:
        name = waiting.pop()
        if name not in texts:
            texts[name] = _module_source(STAND_INS.get(name, name))
            waiting += imported_modules(texts[name])
    modules = "".join(f"    {name!r}: {_quoted(texts[name])},\n" for name in texts)
    template = (HERE / "reader.txt").read_text(encoding="utf-8")
    return template.replace("MODULES = {}", f"MODULES = {{\n{modules}}}")


def imported_modules(text: str) -> list[str]:
    """Return the modules of the pipeline that the module of this ``text`` imports at its top."""
    names = []
    for statement in ast.parse(text).body:
        if isinstance(statement, ast.ImportFrom):
            source = statement.module or ""
            if source.partition(".")[0] == "pipeline":
                names.append(source)
    return names


def _kinds_source(laws: dict[str, str]) -> str:
    """Return a module that builds the ``laws`` (kind → module), in place of KINDS, which finds
    them in folders.
    """
    imports = [f"from {law} import build as build_{kind}" for kind, law in laws.items()]
    builders = ", ".join(f'"{kind}": build_{kind}' for kind in laws)
    template = (HERE / "kinds.txt").read_text(encoding="utf-8")
    return "\n".join(imports) + "\n" + template.replace("LAWS", builders)


def _module_source(name: str) -> str:
    return Path(find_spec(name).origin).read_text(encoding="utf-8")


def _quoted(text: str) -> str:
    """Return ``text`` as a literal of Python that a person can read."""
    plain = "'''" not in text and not text.endswith(("\\", "'"))
    return f"r'''{text}'''" if plain else repr(text)
