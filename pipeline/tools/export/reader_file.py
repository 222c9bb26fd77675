"""One Python file that reads exported models with NumPy alone: the project's own reader and laws,
module after module, under names that do not clash.
"""

import ast
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from pipeline.models.kinds import kinds

NAME = "read_motion_model.py"
READER = "pipeline.models.exported"
# modules that only fits and annotations need, or that the choice of the law below replaces
LEFT_OUT = (
    "pipeline.core.validation",
    "pipeline.models",
    "pipeline.models.kinds",
    "pipeline.models.steps",
)
HEAD = '''"""Reader of the motion models of `python -m pipeline export`; NumPy 2.2 is all it needs.

    from read_motion_model import load
    model = load("MODEL.json")

A copy of the project's own reader (pipeline.models.load): edit it there.
"""

from __future__ import annotations

'''
CHOICE = '''
def build_model(parameters):
    """Build the law of these parameters; raises KeyError for an unknown kind."""
    return {%s}[parameters["kind"]](parameters)
'''
TAIL = '''

def load(file: str | Path) -> ExportedModel:
    """Return the model in ``file``; raises ContractError for any other file."""
    return read_exported(Path(file))
'''


def reader_source() -> str:
    """Return the text of the file :data:`NAME`."""
    laws = {f"pipeline.models.{kind}.law": kind for kind in kinds()}
    outer: set[str] = set()
    bodies: list[str] = []
    named: dict[str, dict[str, str]] = {}  # module → new names of those that clash
    for module in [*dict.fromkeys(each for law in laws for each in _needed(law)), *_needed(READER)]:
        if module in named:
            continue
        if module == READER:
            chosen = [f'"{kind}": {named[law].get("build", "build")}' for law, kind in laws.items()]
            bodies.append(CHOICE % ", ".join(chosen))
        text = _source(module)
        tree, lines = ast.parse(text), text.splitlines()
        taken = {new for names in named.values() for new in names.values()}
        suffix = module.removeprefix("pipeline").replace(".", "_")
        own = {name: name + suffix * (name in taken) for name in _defined(tree)}
        names, named[module] = dict(own), own
        for node in tree.body:
            typing = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
            if not typing and not isinstance(node, ast.Import | ast.ImportFrom):
                continue
            lines[node.lineno - 1 : node.end_lineno] = [""] * (node.end_lineno - node.lineno + 1)
            if _inside(node):
                known = named.get(node.module, {})
                names |= {each.name: known.get(each.name, each.name) for each in node.names}
            elif not typing:
                outer.add(ast.unparse(node))
        body = re.sub(r"\n{4,}", "\n\n\n", "\n".join(lines)).strip() + "\n"
        changed = {name: new for name, new in names.items() if new != name}
        if changed:  # where it is defined or called; a method has a dot before it
            pattern = rf"(?<![\w.])({'|'.join(changed)})(?=\()"
            body = re.sub(pattern, lambda found, new=changed: new[found[0]], body)
        bodies.append(body)
    imports = "\n".join(sorted(line for line in outer if "__future__" not in line))
    return HEAD + imports + "\n\n" + "\n\n".join(bodies) + TAIL


def _needed(module: str) -> Iterator[str]:
    """Yield the modules of the project that ``module`` imports, each behind its own, and itself."""
    if module not in LEFT_OUT:
        for node in ast.parse(_source(module)).body:
            if _inside(node):
                yield from _needed(node.module)
        yield module


def _source(module: str) -> str:
    return Path(find_spec(module).origin).read_text(encoding="utf-8")


def _inside(node: ast.stmt) -> bool:
    return isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "pipeline"


def _defined(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        targets = getattr(node, "targets", [getattr(node, "target", None)])
        for each in (each for target in targets if target for each in ast.walk(target)):
            if isinstance(each, ast.Name):
                yield each.id
