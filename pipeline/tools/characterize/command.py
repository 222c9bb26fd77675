"""``python -m pipeline characterize FOLDER --urdf FILE``: from recordings to the model card and the
exported model in one run.

The dataset's two files are written as by new-dataset and stay; the stages run in
data/characterize/NAME, beside the results of params.yaml's own dataset.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import chain_of
from pipeline.core import config, contracts, datasheet
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.typed_yaml import read_yaml
from pipeline.figures import noise_quantiles
from pipeline.figures.style import save
from pipeline.models.joint_steps_fit import LEAST_SHARE, PLAIN
from pipeline.models.other_motions import other_motions
from pipeline.recordings.motions import Motion, logged_motions
from pipeline.stages import fit, ingest, predict, track
from pipeline.stages.predict import OUT as PREDICTED
from pipeline.tools.export.command import write_export
from pipeline.tools.export.record import bare_record, exported, plain_record
from pipeline.tools.new_dataset.command import write_datasheet
from pipeline.tools.new_dataset.filling import found_motions
from pipeline.verdicts.model_card import model_card
from pipeline.verdicts.recommendation import answer, recommended
from pipeline.verdicts.run import Run

WORK, EXPORTS, REPORTS = Path("data/characterize"), Path("data/export"), Path("reports")
REGULAR = 0.02  # least singular value of J (m/rad), below which a motion is not analysed by J
TOOLS = ("tool0", "flange", "ee_link", "tool")  # usual names of the last link
LINKED = ("pipeline", "dvc.yaml", "data/raw")


def run(words: list[str]) -> None:
    """Write the dataset where there is none of that name, run the stages, and write card and
    export.
    """
    parser = argparse.ArgumentParser(
        prog="python -m pipeline characterize", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="folder of the recordings")
    parser.add_argument("--urdf", type=Path, metavar="FILE", help="arm (default: in FOLDER)")
    parser.add_argument("--name", help="dataset's name (default: from FOLDER)")
    parser.add_argument("--ask", action="store_true", help="asks where the files cannot tell")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="value of an option"
    )
    parser.add_argument("--motion", type=int, metavar="NUMBER", help="analysed motion, from 1")
    parser.add_argument("--scale", default="paper", help="paper (default) or smoke")
    parser.add_argument("--model", help="model to export (default: the recommended one)")
    arguments = parser.parse_args(words)
    name = arguments.name or re.sub(r"\W+", "_", arguments.folder.resolve().name)
    recordings = _dataset(name, arguments)
    with _project(name, recordings, arguments.scale) as root:
        settings = config.composed_config()
        reason = _stages(settings)
        tables, models = _tables(settings, reason)
        card = _run(settings, tables, reason)
        chosen, _ = recommended(tables["other_motions"], tables["motion_spread"], tables["motions"])
        chosen = arguments.model or chosen
        record = None
        if chosen in PLAIN and reason:
            record = bare_record(chosen, settings) | plain_record(chosen, models, settings.dataset)
        elif chosen is not None:
            record = exported(chosen, settings)
        text = model_card(card, [])
        figure = noise_quantiles.draw(tables["noise_quantiles"])
    report = REPORTS / name
    report.mkdir(parents=True, exist_ok=True)
    save(figure, report, "noise_quantiles")
    picture = "![Quantiles of the held-out noise](noise_quantiles.png)"
    text = text.replace("## Tails and coverage\n", f"## Tails and coverage\n\n{picture}\n", 1)
    contracts.write_text(text, report / "model_card.md")
    print(f"\n{answer(card)}\n")
    print(f"characterize: wrote {report / 'model_card.md'}; stages ran in {root}")
    if record is not None:
        write_export(record, EXPORTS / f"{name}_{chosen}.json")


def _dataset(name: str, arguments: argparse.Namespace) -> Path:
    """Write the dataset's files where they are not there, and return the folder of the
    recordings; ConfigError names what is still open.
    """
    option = config.CONF / "dataset" / f"{name}.yaml"
    if not arguments.folder.is_dir():
        raise ConfigError("there is no such folder of recordings", file=arguments.folder)
    if option.exists() and datasheet.path_of(name).exists():
        print(f"characterize: the dataset {name} is there already and is taken as it is")
        left = [*datasheet.unfilled_keys(config.dataset_values(option))]
        if left and (arguments.ask or arguments.set or arguments.motion):
            left = _fill(name, None, arguments)
    else:
        left = _fill(name, arguments.folder, arguments)
    if left and arguments.motion is None and any("joint_log" in key for key in left):
        number = _regular_motion(config.dataset_values(option))
        print(f"characterize: motion {number} is analysed; --motion NUMBER takes another")
        left = write_datasheet(name, None, {}, motion=number, suggested=True, ask=arguments.ask)
    if left:
        raise ConfigError(
            f"the files cannot tell {', '.join(left)}; run it again with --ask, or with --set "
            "KEY=VALUE for each",
            file=option,
        )
    return arguments.folder.resolve()


def _fill(name: str, folder: Path | None, arguments: argparse.Namespace) -> list[str]:
    """Fill in the dataset's files by what was given and, without --ask, by what no analysis depends
    on and the usual name of a last link; return what is left.
    """
    given = dict(each.partition("=")[::2] for each in arguments.set)
    taken = {}
    if folder is not None and not arguments.ask:
        taken = {"about.subject": f"recordings of {name}", "about.source": str(folder)}
        taken = {key: value for key, value in taken.items() if key not in given}
        _say_taken(taken)
    left = write_datasheet(
        name,
        folder,
        taken | given,
        urdf=arguments.urdf if folder is not None else None,
        suggested=True,
        motion=arguments.motion,
        ask=arguments.ask,
    )
    if "robot.tool" not in left or arguments.urdf is None:
        return left
    links = set(re.findall(r'<link\s+name="([^"]+)"', arguments.urdf.read_text()))
    tool = next((tool for tool in TOOLS if tool in links), None)
    if tool is None:
        return left
    _say_taken({"robot.tool": tool})
    return write_datasheet(name, None, {"robot.tool": tool}, suggested=True)


def _say_taken(taken: dict[str, str]) -> None:
    for key, value in taken.items():
        print(f"characterize: took {key}: {value}; --set {key}=VALUE takes another")


def _regular_motion(values: dict) -> int:
    """Number of the motion of most repetitions that stays clear of singular poses, among equals of
    most moving joints, then the longest; 1 where there is none.
    """
    offered = found_motions(values)
    if not offered:
        raise ConfigError("the logs hold no motion that repeats", key="joint_log")
    regular = [
        (len(motion.places) - len(motion.disturbed), _moving(motion), motion.steps, -number)
        for number, motion in enumerate(offered, 1)
        if motion.least_singular >= REGULAR and len(motion.places) > 1
    ]
    return -max(regular)[-1] if regular else 1


def _moving(motion: Motion) -> int:
    way = np.abs(motion.end - motion.start)
    return int(np.sum(way > LEAST_SHARE * way.max()))


@contextmanager
def _project(name: str, recordings: Path, scale: str) -> Iterator[Path]:
    """Work in a fresh folder with a params.yaml for the dataset, and come back."""
    root, place = Path.cwd(), WORK / name
    option = config.dataset_values(config.CONF / "dataset" / f"{name}.yaml")
    urdf = Path(option["robot"]["urdf"]).resolve()
    params = read_yaml(Path("params.yaml"))
    params |= {
        "dataset": name,
        "scale": scale,
        "overrides": {"dataset": {"recordings": str(recordings), "robot": {"urdf": str(urdf)}}},
    }
    shutil.rmtree(place, ignore_errors=True)
    (place / "data").mkdir(parents=True)
    for linked in LINKED:
        (place / linked).symlink_to(root / linked)
    (place / "params.yaml").write_text(json.dumps(params))
    os.chdir(place)
    try:
        config.write_config(Path("params.yaml"))
        yield place
    finally:
        os.chdir(root)


def _stages(settings: config.Config) -> str:
    """Run the stages up to predict; why the matrix models were passed over, if they were."""
    try:
        ingest.run("motion")
        Path("data/ingest/depth").mkdir(exist_ok=True)
        track.run()
        for model in settings.models:
            fit.run(model)
        predict.run()
    except PipelineError as error:
        if settings.dataset.joint_log is None:
            raise
        print(f"characterize: plain models alone, as the analysed motion is refused: {error}")
        return error.message
    return ""


def _tables(settings: config.Config, reason: str) -> tuple[dict[str, pd.DataFrame], list]:
    dataset = settings.dataset
    if not reason:
        names = [file.stem for file in PREDICTED.glob("*.parquet")]
        return {name: contracts.read(name, PREDICTED) for name in names}, []
    motions = logged_motions(dataset)
    if not motions:
        raise ConfigError(f"no motion of the logs can be analysed: {reason}", key="joint_log")
    scored = other_motions(
        motions,
        dataset.robot.joints,
        dataset.motion.rate,
        pose_noise=dataset.motion.pose_noise,
    )
    return dict(scored.tables), motions


def _run(settings: config.Config, tables: dict[str, pd.DataFrame], reason: str) -> Run:
    """The run as the card takes it."""
    dataset, metrics = settings.dataset, {}
    if not reason:
        for model in settings.models:
            file = Path(f"reports/metrics/fit_{model}.json")
            metrics[f"fit_{model}"] = json.loads(file.read_text())
        metrics["motion"] = {
            "recorded_takes": int(contracts.read("joints", track.OUT)["take"].nunique())
        }
        tables |= {"takes": contracts.read("takes", track.OUT)}
    return Run(
        dataset=dataset.name,
        scale=settings.scale.name,
        synthetic=False,
        joints=list(dataset.robot.joints),
        task=list(chain_of(dataset.robot).task),
        models={name: options.kind for name, options in settings.models.items()},
        metrics=metrics,
        tables=tables,
    )
