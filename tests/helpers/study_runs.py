"""The studies by name, their options at a scale, and the files that they wrote."""

from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace

from recordings_of_law import ROOT

from pipeline.core.typed_yaml import read_yaml

NAMES = sorted(
    file.parent.name for file in (ROOT / "pipeline/studies").glob("*/stage.py")
)


def study_of(name: str) -> ModuleType:
    """The module of the study of this name."""
    return import_module(f"pipeline.studies.{name}.stage")


def options_of(name: str, scale: str = "smoke", **changes):
    """The options of a study at a scale, some of them changed."""
    section = read_yaml(ROOT / f"pipeline/studies/{name}/params.yaml")[scale]
    return SimpleNamespace(**section | changes)


def written() -> dict[str, bytes]:
    """Every file below data/studies and reports/studies."""
    folders = (Path("data/studies"), Path("reports/studies"))
    files = [file for folder in folders for file in folder.rglob("*") if file.is_file()]
    return {str(file): file.read_bytes() for file in files}
