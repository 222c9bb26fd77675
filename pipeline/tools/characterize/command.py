"""``python -m pipeline characterize FOLDER --urdf FILE``: model card and exported model from the
recordings in a folder, in one run.

The dataset's two files are written as by new-dataset. The stages run in data/characterize/NAME and
do not change the results of the dataset in params.yaml.
"""

import json
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager, redirect_stdout
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from jinja2 import Template

from pipeline.arm.model import chain_of
from pipeline.arm.urdf import read_urdf
from pipeline.configuration import config, datasheet
from pipeline.configuration.datasheet import get_filled
from pipeline.core import contracts
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.filters import CLOSED
from pipeline.core.typed_yaml import parse_yaml, read_yaml
from pipeline.figures.drawing import figures_in
from pipeline.figures.style import save
from pipeline.models.exported.writer import error_record, write_export
from pipeline.models.joint_error.choice import chosen_law
from pipeline.models.joint_error.fit import FAMILY
from pipeline.models.joint_error.held_out import joint_tables
from pipeline.models.joint_error.samples import JointRun
from pipeline.recordings import quality
from pipeline.recordings.runs import joint_runs
from pipeline.stages import fit, ingest, predict, track
from pipeline.tools.characterize.logs import FolderLogs, folder_logs
from pipeline.tools.export.command import EXPORTS, exported_record
from pipeline.tools.new_dataset.command import (
    Draft,
    assigned_values,
    command_with,
    dataset_files,
    open_draft,
    require_dataset_name,
)
from pipeline.tools.new_dataset.values import KEYS
from pipeline.verdicts.model_card import answer, model_card
from pipeline.verdicts.report_page import with_plain_names
from pipeline.verdicts.run import Run

WORK = Path("data/characterize")
REPORTS = Path("reports")
LOG = Path("stages.log")
LOGGED = Template(Path(__file__).with_name("logged.txt").read_text(encoding="utf-8"))
TOOLS = ("tool0", "flange", "ee_link", "tool")  # usual names of the last link
FIGURES = ("held_out_error", "sigma_over_horizon", "noise_quantiles")
TO_EXPORT = re.compile(r"Export: `python.*\n*")


def run(
    folder: Path,
    set: Sequence[str],
    urdf: Path | None = None,
    name: str | None = None,
    motion: int | None = None,
    ask: bool = False,
    scale: str = "paper",
    model: str | None = None,
) -> None:
    """Write the dataset if it does not exist, run the stages, write model card and export."""
    if not folder.is_dir():
        raise ConfigError("there is no such folder of recordings", file=folder)
    if model is not None:
        config.model_options([model.removesuffix(CLOSED)])
    if scale not in (scales := config.option_names("scale")):
        raise ConfigError(
            f"no scale {scale!r}; there are {', '.join(scales)}",
            key="--scale",
        )
    if name is not None:
        require_dataset_name(name)
    name = name or re.sub(r"\W+", "_", folder.resolve().name)
    assigned = {"robot.urdf": str(urdf)} if urdf else {}
    assigned |= assigned_values(set)
    logged = _logged_runs(folder, assigned)
    if logged and not urdf:
        # the report of a dataset that exists is not overwritten
        if datasheet.path_of(name).exists():
            name += "_logs"
        result = _result_of_logs(logged, name, scale, model)
        source = folder
    else:
        _write_dataset(name, folder, assigned, ask, motion)
        with _project(name, folder.resolve(), scale) as source:
            result = _result_of_stages(logged, name, scale, model)
    _write_card(result.card, source, logged.resampled if logged else {})
    if result.record is not None:
        file = EXPORTS / f"{name}_{result.exported}.json"
        write_export(result.record, file)
        of_logs = {
            key: text
            for key, text in assigned.items()
            if key.startswith(("joint_log.", "motion.rate"))
        }
        command = command_with(f"assess RECORDING --model {file}", of_logs)
        print(f"characterize: `{command}` compares another recording with these")


class RunsOfFolder(NamedTuple):
    """Runs in the logs of a folder, name → reason of what is not used, and log → its resampling."""

    runs: list[JointRun]
    unused: dict[str, str]
    resampled: dict[str, str]


class Result(NamedTuple):
    """Contents of the card, and name and record of the exported model; None without a model."""

    card: Run
    exported: str | None
    record: dict | None


def _result_of_logs(
    logged: RunsOfFolder,
    name: str,
    scale: str,
    model: str | None,
) -> Result:
    """Return the result of the joint error laws on the ``logged`` runs. A ``model`` of the task
    step is refused.
    """
    if model is not None and model not in FAMILY:
        raise ConfigError(
            f"the model {model} needs a Jacobian: give --urdf FILE",
            key="--model",
        )
    tables = joint_tables(logged.runs, config.model_options(FAMILY), logged.unused)
    joints = [*logged.runs[0].joints]
    card = Run(name, scale, False, joints, [], {}, {}, tables)
    exported = model or chosen_law(tables["joint_scores"])[0]
    record = None
    if exported is not None:
        record = _record_of_runs(exported, logged, card)
    return Result(card, exported, record)


def _result_of_stages(
    logged: RunsOfFolder | None,
    name: str,
    scale: str,
    model: str | None,
) -> Result:
    """Run the stages in the current folder; return their result."""
    settings = config.composed_config()
    tables, metrics = _stage_tables(settings, logged)
    robot = settings.dataset.robot
    card = Run(
        name,
        scale,
        synthetic=False,
        joints=list(robot.joints),
        task=list(chain_of(robot).task),
        models={key: options.kind for key, options in settings.models.items()},
        metrics=metrics,
        tables=tables,
    )
    exported = model or chosen_law(tables["joint_scores"])[0]
    if exported is None:
        return Result(card, None, None)
    if logged and exported in FAMILY:
        return Result(card, exported, _record_of_runs(exported, logged, card))
    return Result(card, exported, exported_record(exported, settings))


def _record_of_runs(model: str, logged: RunsOfFolder, card: Run) -> dict:
    """Return the record of a joint error law, fitted to all ``logged`` runs."""
    options = config.model_options([model])[model]
    scores = card.tables["joint_scores"]
    return error_record(model, options, logged.runs, card.dataset, scores)


def _write_card(card: Run, source: Path, resampled: Mapping[str, str]) -> None:
    """Write the card, with the ``resampled`` logs (name → its rows), and its figures; print its
    first paragraphs.
    """
    report = REPORTS / card.dataset
    _draw_figures(card.tables, report / "figures")
    text = model_card(with_plain_names(card), [])
    if resampled:
        logs = [f"{name} ({rows})" for name, rows in resampled.items()]
        text = f"{text.rstrip()}\n\n**Resampled logs of uneven rows:** {'; '.join(logs)}.\n"
    # drop the card's export command, which would export a model of params.yaml's dataset
    contracts.write_text(TO_EXPORT.sub("", text), report / "model_card.md")
    print(f"\n{TO_EXPORT.sub('', answer(card)).rstrip()}\n")
    print(f"characterize: wrote {report / 'model_card.md'} from {source}")


def _draw_figures(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    """Draw the FIGURES of ``tables`` into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = figures_in()
    for name in FIGURES:
        figure = figures[name]
        drawn = figure.draw(**{table: tables[table] for table in figure.tables})
        save(drawn, folder, name)


def _logged_runs(folder: Path, assigned: dict[str, str]) -> RunsOfFolder | None:
    """Return the runs in the joint logs of ``folder``, None without a log; print the runs, what is
    suggested and what is not used.
    """
    logs = folder_logs(folder, assigned)
    if not logs.movements:
        _report_no_log(logs, folder, assigned)
        return None
    stated = parse_yaml(assigned.get("motion.pose_noise", "null"))
    if stated is not None and not (isinstance(stated, int | float) and stated > 0):
        message = f"motion.pose_noise must be a number > 0 in rad, got {stated!r}"
        raise ConfigError(message, key="--set")
    logged = joint_runs(logs.movements, logs.rate, pose_noise=stated)
    unused = logs.unused | logged.unused
    print(LOGGED.render(**logs._asdict() | {"runs": logged.runs, "unused": unused}))
    return RunsOfFolder(logged.runs, unused, logs.resampled)


def _report_no_log(logs: FolderLogs, folder: Path, assigned: Mapping[str, str]) -> None:
    """Print why no joint log of the ``folder`` is used; raise ConfigError if there is no arm."""
    reasons = [f"{name}: {reason}" for name, reason in logs.unused.items()]
    if "robot.urdf" in assigned or any(folder.rglob("*.urdf")):
        for reason in reasons:
            print(f"characterize: not used as a joint log: {reason}")
        return
    reason = "; ".join(reasons) or "there is no table or log in it"
    advice = ""
    if logs.missing:
        command = command_with(f"characterize {folder}", {**assigned, **logs.missing})
        advice = f"Correct the values and run `{command}`. "
    raise ConfigError(
        f"no joint log in the folder can be used: {reason}. {advice}"
        "Other recordings need --urdf FILE",
        file=folder,
    )


def _write_dataset(
    name: str,
    folder: Path,
    assigned: dict[str, str],
    ask: bool,
    motion: int | None,
) -> None:
    """Write the dataset's files if missing or incomplete; ConfigError if a value is still ???."""
    sheet, option = dataset_files(name)
    exists = option.exists() and sheet.exists()
    if exists:
        print(
            f"characterize: the dataset {name} exists; its values are used, and --set changes "
            f"them; to write it again, delete {sheet} and {option}",
        )
        values = config.dataset_values(option)
        assigned = _changed_values(assigned, values)
        if not assigned and not datasheet.is_open(values):
            return
    draft = open_draft(name, None if exists else folder, assigned)
    draft.fill(assigned, suggested=True, motion=motion if ask else None, ask=ask)
    if not ask:
        _fill_usual_values(draft, name, folder, motion or 1)
    draft.write()
    if keys := draft.open_values():
        values = assigned | draft.proposals()
        command = command_with(f"characterize {folder} --name {name}", values)
        choices = "".join(f"; {choice}" for choice in draft.choices())
        raise ConfigError(
            f"the recordings do not state {', '.join(keys)}; run again with --ask, or "
            f"correct the values of this command and run it: `{command}`{choices}",
            file=option,
        )


def _changed_values(assigned: dict[str, str], values: dict) -> dict[str, str]:
    """Return the ``assigned`` values that differ from the dataset's ``values``."""
    changed = {}
    for key, text in assigned.items():
        value = get_filled(values, key)
        if value is None or parse_yaml(text) != value:
            changed[key] = text
    return changed


def _fill_usual_values(draft: Draft, name: str, folder: Path, motion: int) -> None:
    """Fill in values of the ``draft`` that need no answer; print them."""
    usual = {
        "about.subject": f"recordings of {name}",
        "about.source": str(folder),
        "about.licence": "not stated",
    }
    if urdf := get_filled(draft.values(), "robot.urdf"):
        links = read_urdf(Path(urdf)).bodies
        for tool in [tool for tool in TOOLS if tool in links][:1]:
            usual["robot.tool"] = tool
    open_keys = draft.open_values()
    usual = {key: value for key, value in usual.items() if key in open_keys}
    for key, value in usual.items():
        print(f"characterize: {key} is set to {value}; --set {key}=VALUE changes it")
    draft.fill(usual, suggested=True)
    open_keys = {*draft.open_values()}
    if "joint_log.start" in open_keys and open_keys <= {*KEYS}:
        draft.fill({}, motion=motion)
        print(f"characterize: motion {motion} is analysed; --motion NUMBER changes it")


@contextmanager
def _project(name: str, recordings: Path, scale: str) -> Iterator[Path]:
    """Work in a new folder with a params.yaml for the dataset, then return to the old folder."""
    root = Path.cwd()
    place = WORK / name
    option = config.dataset_values(config.CONF / "dataset" / f"{name}.yaml")
    robot = {"urdf": str(Path(option["robot"]["urdf"]).resolve())}
    overrides = {"dataset": {"recordings": str(recordings), "robot": robot}}
    params = {"dataset": name, "scale": scale, "overrides": overrides}
    text = json.dumps(read_yaml(Path("params.yaml")) | params)
    shutil.rmtree(place, ignore_errors=True)
    (place / "data").mkdir(parents=True)
    for linked in ("pipeline", "dvc.yaml", "data/raw"):
        (place / linked).symlink_to(root / linked)
    (place / "params.yaml").write_text(text)
    with chdir(place):
        config.write_config(Path("params.yaml"))
        yield place


def _stage_tables(
    settings: config.Config,
    logged: RunsOfFolder | None,
) -> tuple[dict[str, pd.DataFrame], dict]:
    """Return tables and metrics; of the joint error laws only, if a stage fails."""
    try:
        metrics = _run_stages(settings)
    except PipelineError as error:
        if logged is None:
            raise
        print(
            f"characterize: only joint error laws; the motion cannot be analysed: {error}",
        )
        laws = config.model_options(FAMILY)
        return joint_tables(logged.runs, laws, logged.unused), {}
    tables = {}
    for file in predict.OUT.glob("*.parquet"):
        tables[file.stem] = contracts.read(file.stem, predict.OUT)
    tables["takes"] = quality.side_by_side(contracts.read("takes", track.OUT))
    recorded = contracts.read("joints", track.OUT)["take"].nunique()
    return tables, metrics | {"motion": {"recorded_takes": int(recorded)}}


def _run_stages(settings: config.Config) -> dict[str, dict]:
    """Run the stages until predict; return the numbers of the fits."""
    _run_stage(ingest.run, "motion")
    if settings.dataset.depth is not None:
        _run_stage(ingest.run, "depth")
    _run_stage(track.run)
    metrics = {}
    for model in settings.models:
        _run_stage(fit.run, model)
        text = (fit.OUT / model / "fit.json").read_text()
        metrics[f"fit_{model}"] = json.loads(text)
    _run_stage(predict.run)
    return metrics


def _run_stage(run: Callable[..., None], *words: str) -> None:
    """Run a stage and append its printed messages to the file LOG."""
    name = run.__module__.rpartition(".")[2]
    print(" ".join(["characterize: stage", name, *words]), flush=True)
    with LOG.open("a", encoding="utf-8") as log, redirect_stdout(log):
        run(*words)
