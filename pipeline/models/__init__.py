"""Motion models, one folder each; importing the package imports no model."""

from importlib import import_module
from pathlib import Path


def load(file: str | Path, period: float | None = None):
    """Read an exported model (:class:`pipeline.models.exported.ExportedModel`) from ``file``.

    Raises ContractError for another file, ModelDomainError for other steps than of ``period`` (s).
    """
    exported = (
        "pipeline.models.exported"  # imported by name: no dependency of the stages
    )
    return import_module(exported).read_exported(Path(file), period)
