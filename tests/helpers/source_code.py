"""The modules of the pipeline, their syntax trees, and what each imports."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]


def module_name(file: Path) -> str:
    """The name by which ``file`` is imported; the package itself is ``pipeline.__init__``."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 2 else parts)


MODULES = {
    module_name(file): file for file in sorted((ROOT / "pipeline").rglob("*.py"))
}


def package(module: str) -> str:
    """The folder, or the file, directly under pipeline."""
    return module.split(".")[1]


@cache
def tree(module: str) -> ast.Module:
    """The syntax tree of a module of the pipeline."""
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


@cache
def imports(module: str, top: bool = False) -> frozenset[str]:
    """Every module that is imported anywhere in ``module``, by a statement or by its name in a call
    of import_module; with ``top`` those that are imported when ``module`` is.
    """
    names = set()
    for node in tree(module).body if top else ast.walk(tree(module)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relative to itself"
            members = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {
                member if member in MODULES else node.module for member in members
            }
        elif (
            isinstance(node, ast.Call)
            and getattr(node.func, "id", None) == "import_module"
        ):
            names |= {
                arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)
            }
    return frozenset(names)


def pipeline_imports(module: str) -> set[str]:
    """The modules of the pipeline that ``module`` imports itself."""
    return {name for name in imports(module) if name.startswith("pipeline.")}


def needed(module: str, harmless: set[str]) -> set[str]:
    """The modules that ``module`` runs on, itself and the packages they lie in included, without
    ``harmless`` ones and what those alone import.
    """
    reached = {"pipeline.__init__"}
    waiting = [module]

    while waiting:
        current = waiting.pop()
        if current not in reached | harmless:
            reached.add(current)
            parts = current.split(".")
            packages = {".".join(parts[:depth]) for depth in range(2, len(parts))}
            waiting += [*pipeline_imports(current), *(packages & set(MODULES))]
    return reached


def covers(path: str, other: str) -> bool:
    """True where ``path``, with * for any one name, is ``other`` or a folder it lies in."""
    return (
        re.match(re.escape(path).replace(r"\*", r"[^/]+") + "(/|$)", other) is not None
    )
