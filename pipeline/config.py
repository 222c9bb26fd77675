"""Composes the configuration from params.yaml and pipeline/conf, validates it, and hands each stage its own sections.

The only module that knows Hydra. YAML is read through OmegaConf alone: PyYAML takes 1e-3 for a text.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException
from yaml import YAMLError

from pipeline import schema
from pipeline.errors import ConfigError

CONF = Path(__file__).parent / "conf"
COMPOSED = Path("data/config.yaml")
GROUPS = ("dataset", "filter", "articulation", "simulation", "wrench", "scale", "compute")
# options of the synthetic laboratory, typed where its physics is; looked up only for a dataset that it records
TWIN = {
    "trajectory": "TrajectoryOptions",
    "dynamics": "DynamicsOptions",
    "mocap": "MocapOptions",
    "kinect": "KinectOptions",
    "clock": "ClockOptions",
    "robots": "Robots",
    "transducer": "Transducer",
}


def _load(file: Path) -> DictConfig:
    try:
        loaded = OmegaConf.load(file)
    except FileNotFoundError:
        raise ConfigError("no such file; run the pipeline from the project's root", file=file) from None
    except (YAMLError, OSError, ValueError) as error:
        raise ConfigError(f"cannot be read as YAML: {' '.join(str(error).split())}", file=file) from None
    if not isinstance(loaded, DictConfig):
        raise ConfigError("must hold keys and values", file=file)
    return loaded


def options(group: str) -> list[str]:
    """Names of the options of a group of pipeline/conf."""
    return sorted(file.stem for file in (CONF / group).glob("*.yaml"))


def _structured(structure: Any) -> DictConfig:
    """The type as a node that values can be merged into, also where it nests frozen dataclasses."""
    node = OmegaConf.structured(structure)
    nodes = [node]
    while nodes:
        current = nodes.pop()
        OmegaConf.set_readonly(current, None)
        nodes += [child for child in (current._get_node(key) for key in current) if isinstance(child, DictConfig) and not child._is_none()]
    return node


def _said(error: Exception) -> str:
    """The first line of what Hydra or OmegaConf says, with the keys that there are where one is unknown."""
    said, known = str(error).splitlines()[0], getattr(error, "object_type", None)
    if isinstance(error, ConfigAttributeError | ConfigKeyError) and is_dataclass(known):
        said += f"; there are {', '.join(field.name for field in fields(known))}"
    return said


def _typed(structure: Any, values: Any, section: str = "") -> DictConfig:
    """``values`` of a section checked against a dataclass; ConfigError names the key where they do not fit."""
    prefix = f"{section}." if section else ""
    if not isinstance(values, DictConfig) or values._is_none():
        raise ConfigError("must hold keys and values", key=section)
    try:
        typed = OmegaConf.merge(_structured(structure), values)
        missing = sorted(OmegaConf.missing_keys(typed))
    except OmegaConfBaseException as error:
        raise ConfigError(_said(error), key=(prefix + (getattr(error, "full_key", None) or "")).rstrip(".") or None) from None
    if missing:
        raise ConfigError(f"no value for {', '.join(prefix + name for name in missing)}", key=prefix + missing[0])
    # makes the objects, whose types may check ranges of their own
    OmegaConf.to_object(typed)
    return typed


def compose_config(params_file: Path) -> DictConfig:
    """The whole configuration that ``params_file`` asks for, every interpolation resolved and every key and type checked."""
    loaded = _load(params_file)
    changes = loaded.pop("overrides", None) or OmegaConf.create({})
    if not isinstance(changes, DictConfig):
        raise ConfigError("overrides must hold keys and values", key="overrides", file=params_file)
    try:
        params = OmegaConf.to_container(loaded, resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise ConfigError(_said(error), file=params_file) from None
    known = {*GROUPS, "models", "seed"}
    if unknown := sorted(set(params) - known):
        raise ConfigError(f"unknown key(s) {', '.join(unknown)}; known are {', '.join(sorted({*known, 'overrides'}))}", file=params_file)
    if absent := sorted(known - set(params)):
        raise ConfigError(f"no value for {', '.join(absent)}", file=params_file)
    models = params["models"]
    if not isinstance(models, list) or not models:
        raise ConfigError("models must be a list with at least one option", key="models", file=params_file)
    for group, option in [(group, params[group]) for group in GROUPS] + [("model", model) for model in models]:
        if option not in options(group):
            raise ConfigError(f"{group}: no option {option!r}; there are {', '.join(options(group))}", key=group, file=params_file)
    # imported here: only configure composes, every other stage reads what it composed
    from hydra import compose, initialize_config_dir
    from hydra.errors import HydraException

    overrides = [f"{group}={params[group]}" for group in GROUPS] + [f"+model@models.{model}={model}" for model in models]
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            composed = compose("config", overrides=overrides)
        OmegaConf.set_struct(composed, False)
        composed = OmegaConf.merge(composed, {"seed": params["seed"]}, changes)
        OmegaConf.resolve(composed)
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(_said(error), file=params_file) from None
    config = _typed(schema.Config, composed)
    if config.seed < 0:
        raise ConfigError(f"the seed must not be negative, as {config.seed} is", key="seed", file=params_file)
    if unknown := sorted(set(composed.models) - set(models)):
        raise ConfigError(
            f"no model {', '.join(unknown)} is chosen; there are {', '.join(models)}", key="overrides.models", file=params_file
        )
    for name, model in composed.models.items():
        kind = model.get("kind") if isinstance(model, DictConfig) else None
        if kind not in schema.MODELS:
            raise ConfigError(f"models.{name}.kind: no kind {kind!r}; there are {', '.join(schema.MODELS)}", key=f"models.{name}.kind")
        config.models[name] = _typed(schema.MODELS[kind], model, f"models.{name}")
    twin = composed.dataset.get("twin")
    if twin is not None:
        if not isinstance(twin, DictConfig):
            raise ConfigError("must hold keys and values", key="dataset.twin", file=params_file)
        config.dataset.twin = {part: _typed(_twin_type(part), values, f"dataset.twin.{part}") for part, values in twin.items()}
    return config


def _twin_type(part: str) -> type:
    if part not in TWIN:
        raise ConfigError(f"dataset.twin: no part {part!r}; there are {', '.join(TWIN)}", key=f"dataset.twin.{part}")
    return getattr(import_module("pipeline.twin.options"), TWIN[part])


def write_config(params_file: Path, file: Path = COMPOSED) -> None:
    """Compose and write ``file`` (committed: its difference shows what an edit of the parameters meant)."""
    text = OmegaConf.to_yaml(compose_config(params_file))
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_suffix(".partial")
    partial.write_text(f"# The composed configuration; written by the stage configure from {params_file.name} and pipeline/conf.\n{text}")
    partial.replace(file)


def declared_sections(stage: str, dvc_file: Path) -> list[str]:
    """The sections of the configuration that a stage declares under ``params`` in its ``dvc_file``."""
    stages = OmegaConf.to_container(_load(dvc_file)).get("stages", {})
    if stage not in stages:
        raise ConfigError(f"no stage {stage!r}; there are {', '.join(stages)}", file=dvc_file)
    params = stages[stage].get("params", [])
    return [section for entry in params if isinstance(entry, dict) for section in entry.get(str(COMPOSED), [])]


def sections(stage: str, dvc_file: Path = Path("dvc.yaml"), item: str | None = None) -> SimpleNamespace:
    """What a stage may know: the sections it declares, as typed objects, and where to compute; any other is an AttributeError.

    ``item`` stands for the matrix item in a declared section such as ``models.${item.model}``.
    """
    typed = _typed(schema.Config, _load(COMPOSED))
    handed = SimpleNamespace(compute=OmegaConf.to_object(typed.compute))
    for section in declared_sections(stage, dvc_file):
        keys = [item if key.startswith("${") else key for key in section.replace("${item.model}", "${item}").split(".")]
        place, value = handed, typed
        try:
            for key in keys[:-1]:
                if not hasattr(place, key):
                    setattr(place, key, SimpleNamespace())
                place, value = getattr(place, key), value[key]
            setattr(place, keys[-1], _object(keys, value[keys[-1]]))
        except OmegaConfBaseException:
            raise ConfigError(f"there is no {'.'.join(map(str, keys))} for the stage {stage}", file=COMPOSED) from None
    return handed


def _object(keys: list[str], value: Any) -> Any:
    if keys[0] == "models" and value is not None:
        if len(keys) == 1:
            return {name: _object(["models", name], model) for name, model in value.items()}
        value = OmegaConf.merge(OmegaConf.structured(schema.MODELS[value.kind]), value)
    if keys[:2] == ["dataset", "twin"] and value is not None:
        return {part: OmegaConf.to_object(OmegaConf.merge(_structured(_twin_type(part)), values)) for part, values in value.items()}
    return OmegaConf.to_object(value) if OmegaConf.is_config(value) else value
