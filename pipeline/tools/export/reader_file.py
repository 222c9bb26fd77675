"""One Python file that reads exported models with NumPy alone: the project's own reader and laws,
module after module, under names that do not clash.
"""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from pipeline.models.kinds import kinds

NAME = "read_motion_model.py"
READER = "pipeline.models.exported"
# modules that only fits and annotations need, or that the dispatch below replaces
LEFT_OUT = (
    "pipeline.core.validation",
    "pipeline.models",
    "pipeline.models.kinds",
    "pipeline.models.options",
    "pipeline.models.steps",
    "pipeline.models.wishart.options",
)
HEAD = '''"""Reader of the motion models of `python -m pipeline export`; NumPy 2.2 is all it needs.

    from read_motion_model import load
    model = load("MODEL.json")

A copy of the project's own reader (pipeline.models.load): edit it there.
"""

from __future__ import annotations

'''
TAIL = '''

def load(file: str | Path) -> ExportedModel:
    """Return the model in ``file``; raises ContractError for any other file."""
    return read_exported(Path(file))
'''


def reader_source() -> str:
    """Text of the file :data:`NAME`."""
    laws = {kind: f"pipeline.models.{kind}.law" for kind in kinds()}
    order: list[str] = []
    for module in (*laws.values(), READER):
        _visit(module, order)
    outer, bodies = set(), []
    new_names: dict[str, dict[str, str]] = {}
    taken: set[str] = set()
    for module in order:
        text = _source(module)
        tree = ast.parse(text)
        renamed = {}
        for node in _pipeline_imports(tree):
            renamed |= {
                alias.name: new
                for alias in node.names
                if (new := new_names.get(node.module, {}).get(alias.name))
            }
        own = _defined(tree)
        suffix = "_" + module.removeprefix("pipeline.").replace(".", "_")
        clash = {name: name + suffix for name in own if name in taken}
        taken |= {clash.get(name, name) for name in own}
        new_names[module] = clash
        outer |= {
            ast.unparse(node)
            for node in tree.body
            if isinstance(node, (ast.Import, ast.ImportFrom)) and not _inside(node)
        }
        bodies.append(_rename(_without_imports(text, tree), renamed | clash))
        if module == order[-2]:
            bodies.append(_dispatch(laws, new_names))
    imports = "\n".join(sorted(line for line in outer if "__future__" not in line))
    return HEAD + imports + "\n\n" + "\n\n".join(bodies) + TAIL


def _dispatch(laws: Mapping[str, str], new_names: Mapping[str, Mapping[str, str]]) -> str:
    entries = ", ".join(
        f'"{kind}": {new_names[module].get("build", "build")}' for kind, module in laws.items()
    )
    return f"""
def build_model(parameters):
    \"\"\"Build the law of these parameters; raises KeyError for an unknown kind.\"\"\"
    return {{{entries}}}[parameters["kind"]](parameters)
"""


def _visit(module: str, order: list[str]) -> None:
    """Add ``module`` to ``order`` behind all that it imports of the project."""
    if module in order or module in LEFT_OUT:
        return
    for node in _pipeline_imports(ast.parse(_source(module))):
        _visit(node.module, order)
    order.append(module)


def _source(module: str) -> str:
    return Path(find_spec(module).origin).read_text(encoding="utf-8")


def _inside(node: ast.stmt) -> bool:
    names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
    names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
    return any(name.split(".")[0] == "pipeline" for name in names)


def _pipeline_imports(tree: ast.Module) -> list[ast.ImportFrom]:
    return [node for node in tree.body if isinstance(node, ast.ImportFrom) and _inside(node)]


def _defined(tree: ast.Module) -> list[str]:
    names = []
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.append(node.name)
        targets = node.targets if isinstance(node, ast.Assign) else []
        targets = [node.target] if isinstance(node, ast.AnnAssign) else targets
        names += [
            each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)
        ]
    return names


def _without_imports(text: str, tree: ast.Module) -> str:
    lines = text.splitlines()
    for node in tree.body:
        typing = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        if typing or isinstance(node, (ast.Import, ast.ImportFrom)):
            lines[node.lineno - 1 : node.end_lineno] = [None] * (node.end_lineno - node.lineno + 1)
    return "\n".join(line for line in lines if line is not None).strip() + "\n"


def _rename(text: str, names: Mapping[str, str]) -> str:
    """``text`` with the names replaced, but for attributes and the keywords of calls."""
    if not names:
        return text
    lines = text.splitlines(keepends=True)
    tokens = [*tokenize.generate_tokens(io.StringIO(text).readline)]
    depth, found = 0, []
    for before, token, after in zip(tokens, tokens[1:], tokens[2:], strict=False):
        depth += (before.string in "([{") - (before.string in ")]}") if before.string else 0
        keyword = depth > 0 and after.string == "="
        if token.type == tokenize.NAME and before.string != "." and not keyword:
            if token.string in names:
                found.append(token)
    for token in reversed(found):
        row, column = token.start
        line = lines[row - 1]
        new = names[token.string]
        lines[row - 1] = line[:column] + new + line[column + len(token.string) :]
    return "".join(lines)
