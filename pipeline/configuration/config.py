"""Composition of the configuration with Hydra, its validation, and the sections of each stage."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, field, make_dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, Literal

from pydantic import Field

from pipeline.configuration import datasheet
from pipeline.core.contracts import write_text
from pipeline.core.errors import ConfigError
from pipeline.core.filters import KINDS
from pipeline.core.options import analysis
from pipeline.core.options.dataset import Dataset
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import all_faults, joined_faults, options, validated
from pipeline.models.kinds import options_type

CONF = Path(__file__).parents[1] / "conf"
COMPOSED = Path("data/config.yaml")
ENVIRONMENT = re.compile(r"\$\{\s*oc\.env\b")  # an interpolation of OmegaConf
GROUPS = (
    "dataset",
    "filter",
    "articulation",
    "simulation",
    "wrench",
    "scale",
    "compute",
)


@options()
class Params:
    """Keys of params.yaml: option files by group, seed, and values that override the options."""

    dataset: str
    models: Annotated[list[str], Field(min_length=1)]
    filter: str
    articulation: str
    simulation: str
    wrench: str
    scale: str
    compute: str
    seed: Annotated[int, Field(ge=0)]
    overrides: dict[str, Any] | None = None


@options()
class Config:
    """Sections of the whole configuration."""

    seed: Annotated[int, Field(ge=0)]
    dataset: Dataset
    models: dict[str, Any]
    filter: analysis.Filter
    articulation: analysis.ArticulationSection
    wrench: analysis.Wrench
    simulation: analysis.Simulation
    scale: analysis.Scale
    compute: analysis.Compute
    # derived: the first of ``models`` of each of the paper's kinds, by kind. A stage that declares
    # this section does not run again for a further model
    paper_models: dict[str, Any] = field(default_factory=dict)


def option_names(group: str) -> list[str]:
    """Names of the option files of a group of pipeline/conf."""
    return sorted(file.stem for file in (CONF / group).glob("*.yaml"))


def require_dataset(name: object) -> None:
    """Raise ConfigError with the names of all datasets where there is no dataset ``name``."""
    if name not in (names := option_names("dataset")):
        message = f"no dataset {name!r}; there are {', '.join(names)}; new-dataset creates another"
        raise ConfigError(message, key="dataset")


def compose_config(params_file: Path) -> Config:
    """Return the validated configuration of ``params_file``; ConfigError with all faults."""
    params = validated(Params, read_yaml(params_file), file=params_file)
    faults = _option_faults(params)
    if faults:
        raise joined_faults(faults, params_file)
    sheet = datasheet.read(datasheet.path_of(params.dataset))
    option_file = CONF / "dataset" / f"{params.dataset}.yaml"
    overrides = [f"{group}={getattr(params, group)}" for group in GROUPS]
    overrides += [f"+model@models.{model}={model}" for model in params.models]
    changes = {"seed": params.seed}, params.overrides or {}
    try:
        values = _compose(overrides, sheet, option_file, *changes)
    except ConfigError as error:
        evidence = {"file": params_file} | error.evidence
        raise ConfigError(error.message, **evidence) from None
    open_keys = [*datasheet.unfilled_keys(values["dataset"])]
    if open_keys:
        config = None
        faults = datasheet.to_fill_in(open_keys)
    else:
        config, faults = _validate(values)
    unknown = sorted(set(values["models"] or {}) - set(params.models))
    if unknown:
        message = f"no model {', '.join(unknown)} is chosen; there are {', '.join(params.models)}"
        faults.append(ConfigError(message, key="overrides.models"))
    if faults:
        key = str(faults[0].evidence.get("key"))
        raise joined_faults(faults, _stating(key, params, params_file, sheet))
    return config


def _option_faults(params: Params) -> list[ConfigError]:
    """Return the faults of options and models without a file, and of repeated models."""
    faults = []
    for group in GROUPS:
        faults += _unknown_option(group, getattr(params, group), key=group)
    for model in params.models:
        faults += _unknown_option("model", model, key="models")
    repeated = {name for name in params.models if params.models.count(name) > 1}
    if repeated:
        message = f"models: {', '.join(sorted(repeated))} occurs twice"
        faults.append(ConfigError(message, key="models"))
    return faults


def _unknown_option(group: str, option: str, key: str) -> list[ConfigError]:
    """Return the fault of an ``option`` without a file in its ``group``; [] if it has one."""
    names = option_names(group)
    if option in names:
        return []
    message = f"{group}: no option {option!r}; there are {', '.join(names)}"
    return [ConfigError(message, key=key)]


def _stating(
    key: str,
    params: Params,
    params_file: Path,
    sheet: datasheet.Datasheet,
) -> Path:
    """Return the file that has the longest part of the nested ``key``: ``params_file``, the
    datasheet, or the option file of the section or model.
    """
    section, *below = key.partition("[")[0].split(".")
    sources = {params_file: params.overrides, sheet.file: {"dataset": sheet.values}}
    if section == "models" and below:
        file = CONF / "model" / f"{below[0]}.yaml"
        nested = [section, below[0]]
    else:
        file = CONF / section / f"{vars(params).get(section)}.yaml"
        nested = [section]
    if file.is_file():
        sources[file] = _nested_in(nested, read_yaml(file))
    places = [section, *below]
    return max(sources, key=lambda file: _count_inside(sources[file], places))


def _nested_in(keys: Sequence[str], values: Any) -> Any:
    """Return ``values`` below the nested ``keys``."""
    for key in reversed(keys):
        values = {key: values}
    return values


def _count_inside(values: Any, keys: Sequence[str]) -> int:
    """Return how many of the nested ``keys``, from the first, are in ``values``."""
    count = 0
    for key in keys:
        if not isinstance(values, dict) or key not in values:
            break
        values = values[key]
        count += 1
    return count


def _validate(values: dict[str, Any]) -> tuple[Config | None, list[ConfigError]]:
    """Return the typed configuration, None where there are faults, and all faults."""
    config, faults = all_faults(Config, values)
    models, faults_of_models = _typed_models(values.get("models"))
    laboratory, faults_of_laboratory = _typed_laboratory(values)
    faults += [*faults_of_models, *faults_of_laboratory]
    if faults:
        return None, faults
    config.models, config.dataset.laboratory = models, laboratory
    config.paper_models = first_of_kinds(models)
    return config, []


def _typed_models(models: Any) -> tuple[dict[str, Any], list[ConfigError]]:
    """Return the options of the ``models`` by their kinds' types, and all faults."""
    typed_models: dict[str, Any] = {}
    faults = []
    if not isinstance(models, dict):
        return typed_models, faults
    for name, model in models.items():
        key = f"models.{name}"
        kind = model.get("kind") if isinstance(model, dict) else None
        try:
            typed_models[name], model_faults = all_faults(
                options_type(kind),
                model,
                key,
            )
            faults += model_faults
        except ConfigError as error:
            faults.append(ConfigError(f"{key}.{error.message}", key=f"{key}.kind"))
    return typed_models, faults


def _typed_laboratory(values: Any) -> tuple[dict[str, Any] | None, list[ConfigError]]:
    """Return the typed sections of the dataset's laboratory, None without one, and all faults."""
    laboratory = datasheet.get_nested(values, "dataset.laboratory")
    if laboratory is None:
        return None, []
    cause = datasheet.get_nested(laboratory, "cause")
    structure = _laboratory_type(str(cause))
    typed, faults = all_faults(structure, laboratory, "dataset.laboratory")
    if typed is not None:
        laboratory = {section: getattr(typed, section) for section in laboratory}
    return laboratory, faults


def first_of_kinds(models: dict[str, Any]) -> dict[str, Any]:
    """Return by kind the first of the ``models`` of each of the paper's kinds."""
    result = {}
    for kind in KINDS:
        of_kind = [model for model in models.values() if model.kind == kind]
        if of_kind:
            result[kind] = of_kind[0]
    return result


@cache
def _laboratory_type(cause: str) -> type:
    """Return the type of the section laboratory, whose dynamics have the defaults of ``cause``."""
    # a recorded dataset has no laboratory
    from pipeline.laboratory.causes import cause_names, dynamics_type
    from pipeline.laboratory.options import SECTIONS

    sections = SECTIONS | {"dynamics": dynamics_type(cause)}
    fields = [("cause", Literal[*cause_names()] | None, None)]
    fields += [(name, structure, None) for name, structure in sections.items()]
    return options()(make_dataclass("Laboratory", fields))


def _compose(
    overrides: list[str],
    sheet: datasheet.Datasheet,
    option_file: Path,
    *changes: dict[str, Any],
) -> dict[str, Any]:
    """Return the option files of ``overrides`` merged with ``sheet`` and ``changes``, resolved.

    Raises ConfigError for Hydra's errors, and for a key in both the sheet and ``option_file``.
    """
    # imported here, as most stages read the composed file
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        with initialize_config_dir(
            str(option_file.resolve().parents[1]),
            version_base="1.3",
        ):
            composed = hydra_compose("config", overrides=overrides)
        OmegaConf.set_struct(composed, False)
        option = OmegaConf.to_container(composed, resolve=False)["dataset"]
        facts = datasheet.facts_beside(option, sheet.values)
        if keys := list(datasheet.common_keys(option, facts, "dataset.")):
            message = (
                f"also in {option_file.name}: {', '.join(keys)}; keep each in one file"
            )
            raise ConfigError(message, key=keys[0], file=sheet.file)
        _require_plain({"dataset": sheet.values}, file=sheet.file)
        merged = OmegaConf.merge(composed, {"dataset": facts}, *changes)
        _require_plain(OmegaConf.to_container(merged, resolve=False))
        return OmegaConf.to_container(merged, resolve=True)
    except (HydraException, OmegaConfBaseException, TypeError, ValueError) as error:
        raise ConfigError(str(error).splitlines()[0]) from None


def _require_plain(values: Any, key: str = "", **evidence: object) -> None:
    """Raise ConfigError for a text in ``values`` that reads a variable of the environment, whose
    value would stand in a committed file.
    """
    if isinstance(values, dict):
        for name, value in values.items():
            _require_plain(value, f"{key}.{name}" if key else str(name), **evidence)
    elif isinstance(values, list):
        for place, value in enumerate(values):
            _require_plain(value, f"{key}[{place}]", **evidence)
    elif isinstance(values, str) and ENVIRONMENT.search(values):
        message = f"{values!r} reads a variable of the environment, whose value the run would write"
        raise ConfigError(
            f"{message} to committed files: write the value",
            key=key,
            **evidence,
        )


def dataset_values(option_file: Path) -> dict[str, Any]:
    """Values of the dataset's ``option_file`` and datasheet, including ``about`` and ???."""
    file = datasheet.path_of(option_file.stem)
    values = read_yaml(file)
    about = {"about": values.pop("about")} if "about" in values else {}
    sheet = datasheet.Datasheet(file, values)
    return (
        about | _compose([f"dataset={option_file.stem}"], sheet, option_file)["dataset"]
    )


def write_config(params_file: Path, file: Path = COMPOSED) -> None:
    """Compose the configuration and write ``file``; git then shows the effect of an edit."""
    from omegaconf import OmegaConf

    text = OmegaConf.to_yaml(OmegaConf.create(asdict(compose_config(params_file))))
    head = "# The composed configuration; written by the stage configure from "
    write_text(f"{head}{params_file.name} and pipeline/conf.\n{text}", file)


def composed_config() -> Config:
    """Return the configuration that the stage configure wrote; ConfigError where it is faulty."""
    config, faults = _validate(read_yaml(COMPOSED))
    if faults:
        raise joined_faults(faults, COMPOSED)
    return config


def sections(
    stage: str,
    dvc_file: Path = Path("dvc.yaml"),
    item: str | None = None,
) -> SimpleNamespace:
    """Return the typed sections that a stage declares, and ``compute``; ``item`` replaces the item
    of a matrix in a section such as ``models.${item.model}``.

    Raises ConfigError where a study or tool (``dvc_file`` in the pipeline's folder) declares the
    robot and the dataset has none. The paper's stages accept such a dataset.
    """
    config = composed_config()
    stages = read_yaml(dvc_file).get("stages", {})
    if stage not in stages:
        raise ConfigError(
            f"no stage {stage!r}; there are {', '.join(stages)}",
            file=dvc_file,
        )
    declared = []
    for entry in stages[stage].get("params", []):
        if isinstance(entry, dict):
            declared += entry.get(str(COMPOSED), [])
    settings = SimpleNamespace(compute=config.compute)
    beyond = dvc_file.resolve().is_relative_to(CONF.parent)
    if beyond and "dataset.robot" in declared and config.dataset.robot is None:
        message = f"the stage {stage} needs a robot, and the dataset has none; choose another "
        raise ConfigError(f"{message}dataset in params.yaml", key="dataset.robot")
    for section in declared:
        name = re.sub(r"\$\{item\.\w+\}", str(item), section)
        *above, last = name.split(".")
        place = settings
        value = vars(config)
        for key in above:
            place = vars(place).setdefault(key, SimpleNamespace())
            value = value[key]
            value = value if isinstance(value, dict) else vars(value)
        if last not in value:
            raise ConfigError(
                f"there is no {name} for the stage {stage}",
                file=COMPOSED,
            )
        setattr(place, last, value[last])
    return settings


def study_options(folder: Path, structure: type) -> Any:
    """Return the options of the study in ``folder`` for the run's scale, of type ``structure``."""
    file = folder / "params.yaml"
    scale = read_yaml(COMPOSED)["scale"]["name"]
    if scale not in (values := read_yaml(file)):
        raise ConfigError(f"no section for the scale {scale}", key=scale, file=file)
    return validated(structure, values[scale], scale, file)


def model_options(names: Iterable[str]) -> dict[str, Any]:
    """Return the typed options of models by the ``names`` of their option files."""
    result = {}
    model_names = option_names("model")
    for name in names:
        file = CONF / "model" / f"{name}.yaml"
        if name not in model_names:
            message = f"no model {name!r}; there are {', '.join(model_names)}"
            raise ConfigError(message, file=file)
        values = read_yaml(file)
        result[name] = validated(options_type(values.get("kind")), values, name, file)
    return result
