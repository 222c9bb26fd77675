"""Composes the configuration from params.yaml, pipeline/conf and the dataset's datasheet, validates
it, and hands each stage its sections.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.core import datasheet
from pipeline.core.composition import composed_with
from pipeline.core.errors import ConfigError
from pipeline.core.options.config import Config
from pipeline.core.typed_yaml import load_yaml, read_yaml, said, structured, typed

CONF = Path(__file__).parents[1] / "conf"
COMPOSED = Path("data/config.yaml")
GROUPS = ("dataset", "filter", "articulation", "simulation", "wrench", "scale", "compute")
# options of the synthetic laboratory, typed where its physics is; for what it records alone
LABORATORY = {
    "trajectory": "TrajectoryOptions",
    "dynamics": "DynamicsOptions",
    "mocap": "MocapOptions",
    "kinect": "KinectOptions",
    "clock": "ClockOptions",
    "encoders": "EncoderOptions",
    "robots": "Robots",
    "transducer": "Transducer",
}


def options(group: str) -> list[str]:
    """Names of the options of a group of pipeline/conf."""
    return sorted(file.stem for file in (CONF / group).glob("*.yaml"))


def compose_config(params_file: Path) -> DictConfig:
    """The whole configuration that ``params_file`` asks for, every interpolation resolved and every
    key and type checked.
    """
    loaded = load_yaml(params_file)
    changes = loaded.pop("overrides", None) or OmegaConf.create({})
    if not isinstance(changes, DictConfig):
        raise ConfigError("overrides must hold keys and values", key="overrides", file=params_file)
    try:
        params = OmegaConf.to_container(loaded, resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise ConfigError(said(error), file=params_file) from None
    known = {*GROUPS, "models", "seed"}
    if unknown := sorted(set(params) - known):
        there_are = ", ".join(sorted({*known, "overrides"}))
        message = f"unknown key(s) {', '.join(unknown)}; known are {there_are}"
        raise ConfigError(message, file=params_file)
    if absent := sorted(known - set(params)):
        raise ConfigError(f"no value for {', '.join(absent)}", file=params_file)
    models = params["models"]
    if not isinstance(models, list) or not models:
        raise ConfigError(
            "models must be a list with at least one option", key="models", file=params_file
        )
    for group, option in [(group, params[group]) for group in GROUPS] + [
        ("model", model) for model in models
    ]:
        if option not in options(group):
            raise ConfigError(
                f"{group}: no option {option!r}; there are {', '.join(options(group))}",
                key=group,
                file=params_file,
            )
    sheet = datasheet.read(datasheet.path_of(params["dataset"]))
    option_file = CONF / "dataset" / f"{params['dataset']}.yaml"
    overrides = [f"{group}={params[group]}" for group in GROUPS] + [
        f"+model@models.{model}={model}" for model in models
    ]
    try:
        composed = composed_with(overrides, sheet, option_file, {"seed": params["seed"]}, changes)
    except ConfigError as error:
        raise ConfigError(error.message, **({"file": params_file} | error.evidence)) from None
    if "elimination" in composed.dataset:
        raise ConfigError(
            "a dataset no longer names a decomposition; remove this key and state decomposition in "
            "pipeline/conf/model/wishart.yaml (by_shape, pivoted_lu, qr, qr_transposed or given)",
            key="dataset.elimination",
            file=sheet.file if sheet.holds("elimination") else option_file,
        )
    datasheet.require_filled(composed, sheet, option_file)
    try:
        config = typed(Config, composed)
    except ConfigError as error:
        # who asks for a value that nobody gave, or gave wrongly, is told where the datasheet is
        # where it stands there
        section, _, key = str(error.evidence.get("key")).partition(".")
        file = sheet.file if section == "dataset" and sheet.holds(key) else None
        raise ConfigError(error.message, **({"file": file} | error.evidence)) from None
    if config.seed < 0:
        message = f"the seed must not be negative, as {config.seed} is"
        raise ConfigError(message, key="seed", file=params_file)
    if unknown := sorted(set(composed.models) - set(models)):
        raise ConfigError(
            f"no model {', '.join(unknown)} is chosen; there are {', '.join(models)}",
            key="overrides.models",
            file=params_file,
        )
    _type_models(config.models, composed.models)
    laboratory = composed.dataset.get("laboratory")
    if laboratory is not None:
        if not isinstance(laboratory, DictConfig):
            raise ConfigError(
                "must hold keys and values", key="dataset.laboratory", file=params_file
            )
        config.dataset.laboratory = {
            part: typed(_laboratory_type(part), values, f"dataset.laboratory.{part}")
            for part, values in laboratory.items()
        }
    return config


def _type_models(models: DictConfig, values: DictConfig) -> None:
    """Put ``values``, each checked against the type of its kind, into ``models``."""
    for name, model in values.items():
        kind, key = model.get("kind") if isinstance(model, DictConfig) else None, f"models.{name}"
        try:
            kind_options = _model_type(kind)
        except ConfigError as error:
            raise ConfigError(f"{key}.{error.message}", key=f"{key}.kind") from None
        models[name] = typed(kind_options, model, key)


def _model_type(kind: object) -> type:
    # by its place, as rooms import core and not the other way
    return import_module("pipeline.models.kinds").options_type(kind)


def _laboratory_type(part: str) -> type:
    if part not in LABORATORY:
        message = f"dataset.laboratory: no part {part!r}; there are {', '.join(LABORATORY)}"
        raise ConfigError(message, key=f"dataset.laboratory.{part}")
    return getattr(import_module("pipeline.laboratory.options"), LABORATORY[part])


def write_config(params_file: Path, file: Path = COMPOSED) -> None:
    """Compose and write ``file`` (committed: its difference shows what an edit of the parameters
    meant).
    """
    text = OmegaConf.to_yaml(compose_config(params_file))
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_suffix(".partial")
    partial.write_text(
        f"# The composed configuration; written by the stage configure from {params_file.name} "
        f"and pipeline/conf.\n{text}"
    )
    partial.replace(file)


def declared_sections(stage: str, dvc_file: Path) -> list[str]:
    """The sections of the configuration that a stage declares under ``params`` in its
    ``dvc_file``.
    """
    stages = read_yaml(dvc_file).get("stages", {})
    if stage not in stages:
        raise ConfigError(f"no stage {stage!r}; there are {', '.join(stages)}", file=dvc_file)
    params = stages[stage].get("params", [])
    return [
        section
        for entry in params
        if isinstance(entry, dict)
        for section in entry.get(str(COMPOSED), [])
    ]


def sections(
    stage: str, dvc_file: Path = Path("dvc.yaml"), item: str | None = None
) -> SimpleNamespace:
    """What a stage may know: the sections it declares, as typed objects, and where to compute; any
    other is an AttributeError.

    ``item`` stands for the matrix item in a declared section such as ``models.${item.model}``.
    A study or a tool, whose ``dvc_file`` is in the pipeline's folder, is refused a dataset without
    the robot that it declares: ConfigError. The paper's stages pass over that.
    """
    config = typed(Config, load_yaml(COMPOSED))
    handed = SimpleNamespace(compute=OmegaConf.to_object(config.compute))
    declared = declared_sections(stage, dvc_file)
    beyond = dvc_file.resolve().is_relative_to(CONF.parent)
    if beyond and "dataset.robot" in declared and config.dataset.robot is None:
        raise ConfigError(
            f"{stage} is about a robot's motion, and the dataset has no robot; choose another "
            "dataset in params.yaml",
            key="dataset.robot",
        )
    for section in declared:
        keys = [
            item if key.startswith("${") else key
            for key in section.replace("${item.model}", "${item}").split(".")
        ]
        place, value = handed, config
        try:
            for key in keys[:-1]:
                if not hasattr(place, key):
                    setattr(place, key, SimpleNamespace())
                place, value = getattr(place, key), value[key]
            setattr(place, keys[-1], _object(keys, value[keys[-1]]))
        except OmegaConfBaseException:
            raise ConfigError(
                f"there is no {'.'.join(map(str, keys))} for the stage {stage}", file=COMPOSED
            ) from None
    return handed


def _object(keys: list[str], value: Any) -> Any:
    if keys[0] == "models" and value is not None:
        if len(keys) == 1:
            return {name: _object(["models", name], model) for name, model in value.items()}
        value = OmegaConf.merge(OmegaConf.structured(_model_type(value.kind)), value)
    if keys[:2] == ["dataset", "laboratory"] and value is not None:
        return {
            part: OmegaConf.to_object(OmegaConf.merge(structured(_laboratory_type(part)), values))
            for part, values in value.items()
        }
    return OmegaConf.to_object(value) if OmegaConf.is_config(value) else value


def study_options(folder: Path, structure: type) -> Any:
    """The options of the study in ``folder``, of its ``params.yaml``: the section of the scale that
    the experiment runs at, as an object of the dataclass ``structure``.
    """
    file, scale = folder / "params.yaml", load_yaml(COMPOSED).scale.name
    try:
        section = load_yaml(file).get(scale)
        if section is None:
            raise ConfigError(f"no section for the scale {scale}", key=scale)
        return OmegaConf.to_object(typed(structure, section, scale))
    except ConfigError as error:
        raise ConfigError(error.message, **({"file": file} | error.evidence)) from None


def model_options(names: Iterable[str]) -> dict[str, Any]:
    """The typed options of models by the names of their option files, chosen by the run or not."""
    files = {name: CONF / "model" / f"{name}.yaml" for name in names}
    known = ", ".join(options("model"))
    for name, file in files.items():
        if not file.is_file():
            raise ConfigError(f"no model {name!r}; there are {known}", file=file)
    dataset, typed_options = load_yaml(COMPOSED).dataset, {}
    for name, file in files.items():
        whole = OmegaConf.create({"dataset": dataset, "model": load_yaml(file)})
        OmegaConf.resolve(values := whole.model)
        typed_options[name] = OmegaConf.to_object(typed(_model_type(values.kind), values, name))
    return typed_options
