"""The option files of pipeline/conf put together with a dataset's datasheet; the only module that
knows Hydra.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.core import datasheet
from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import load_yaml, said


def composed_with(
    overrides: list[str], sheet: datasheet.Datasheet, option_file: Path, *changes: Any
) -> DictConfig:
    """The experiment of ``overrides``, with what ``sheet`` and the ``changes`` add; ConfigError for
    what Hydra refuses, and for keys that stand both in the sheet and in ``option_file``.
    """
    # imported here: only what composes needs it, every other stage reads what was composed
    from hydra import compose, initialize_config_dir
    from hydra.errors import HydraException

    try:
        with initialize_config_dir(str(option_file.resolve().parents[1]), version_base="1.3"):
            composed = compose("config", overrides=overrides)
        OmegaConf.set_struct(composed, False)
        datasheet.require_apart(composed._get_node("dataset"), sheet, option_file)
        composed = OmegaConf.merge(composed, {"dataset": sheet.values}, *changes)
        OmegaConf.resolve(composed)
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(said(error)) from None
    return composed


def dataset_values(option_file: Path) -> dict[str, Any]:
    """What the dataset's ``option_file`` and its datasheet hold, ``about`` too, whether filled in
    or not.
    """
    file = datasheet.path_of(option_file.stem)
    whole = load_yaml(file)
    about = whole.pop("about", None)
    sheet = datasheet.Datasheet(file, whole)
    composed = composed_with([f"dataset={option_file.stem}"], sheet, option_file)
    values = OmegaConf.to_container(composed.dataset)
    return values if about is None else {"about": OmegaConf.to_container(about)} | values
