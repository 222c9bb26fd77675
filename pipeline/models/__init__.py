"""Motion models, one folder each; importing the package imports no model."""

from importlib import import_module
from pathlib import Path

# imported by name: the reader of exported models is no dependency of the stages
READER = "pipeline.models.exported.reader"


def load(file: str | Path, period: float | None = None):
    """Read an exported model (:class:`pipeline.models.exported.reader.ExportedModel`) from
    ``file``, with NumPy alone.

    Raises ContractError for another file, ModelDomainError for other steps than of ``period`` (s).
    """
    return import_module(READER).read_exported(Path(file), period)
