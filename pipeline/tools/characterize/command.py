"""``python -m pipeline characterize FOLDER --urdf FILE``: from recordings to the model card and the
exported model in one run.

The dataset's two files are written as by new-dataset and stay; the stages run in
data/characterize/NAME, beside the results of params.yaml's own dataset.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Collection, Iterator, Sequence
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
from pipeline.models.joint_steps_fit import LEAST_SHARE
from pipeline.models.other_motions import other_motions
from pipeline.recordings.motions import FoundMotion, logged_motions
from pipeline.stages import fit, ingest, predict, track
from pipeline.tools.export.command import exported, write_export
from pipeline.tools.new_dataset.command import open_dataset
from pipeline.tools.new_dataset.filling import KEYS, found_motions
from pipeline.verdicts.model_card import model_card
from pipeline.verdicts.recommendation import answer, recommended
from pipeline.verdicts.run import Run

WORK, EXPORTS, REPORTS = Path("data/characterize"), Path("data/export"), Path("reports")
REGULAR = 0.02  # least singular value of J (m/rad), below which a motion is not analysed by J
TOOLS = ("tool0", "flange", "ee_link", "tool")  # usual names of the last link
LINKED = ("pipeline", "dvc.yaml", "data/raw")
PICTURE = "![Quantiles of the held-out noise](noise_quantiles.png)"
ARGUMENTS = {
    "folder": {"type": Path, "metavar": "FOLDER", "help": "folder of the recordings"},
    "--urdf": {"type": Path, "metavar": "FILE", "help": "arm (default: in FOLDER)"},
    "--name": {"help": "dataset's name (default: from FOLDER)"},
    "--ask": {"action": "store_true", "help": "asks where the files cannot tell"},
    "--set": {
        "action": "append",
        "default": [],
        "metavar": "KEY=VALUE",
        "help": "value that no file states, as robot.tool=flange; as often as needed",
    },
    "--motion": {"type": int, "metavar": "NUMBER", "help": "analysed motion, from 1"},
    "--scale": {"default": "paper", "help": "paper (default) or smoke"},
    "--model": {"help": "model to export (default: the recommended one)"},
}


def run(
    folder: Path, *, name: str | None, scale: str, model: str | None, set: Sequence[str], **options
) -> None:
    """Write the dataset where there is none of that name, run the stages, and write card and
    export; ``options`` are those of :func:`_dataset`.
    """
    name = name or re.sub(r"\W+", "_", folder.resolve().name)
    answers = dict(each.partition("=")[::2] for each in set)
    _dataset(name, folder, answers, **options)
    with _project(name, folder.resolve(), scale) as root:
        settings = config.composed_config()
        motions, tables, metrics = _results(settings)
        card = Run(
            dataset=name,
            scale=scale,
            synthetic=False,
            joints=list(settings.dataset.robot.joints),
            task=list(chain_of(settings.dataset.robot).task),
            models={each: options.kind for each, options in settings.models.items()},
            metrics=metrics,
            tables=tables,
        )
        best, _ = recommended(tables["other_motions"], tables["motion_spread"], tables["motions"])
        chosen = model or best
        record = None if chosen is None else exported(chosen, settings, motions)
        text = model_card(card, [])
        figure = noise_quantiles.draw(tables["noise_quantiles"])
    report = REPORTS / name
    report.mkdir(parents=True, exist_ok=True)
    save(figure, report, "noise_quantiles")
    text = text.replace("## Tails and coverage\n", f"## Tails and coverage\n\n{PICTURE}\n", 1)
    contracts.write_text(text, report / "model_card.md")
    print(f"\n{answer(card)}\n")
    print(f"characterize: wrote {report / 'model_card.md'}; stages ran in {root}")
    if record is not None:
        write_export(record, EXPORTS / f"{name}_{chosen}.json")


def _dataset(
    name: str,
    folder: Path,
    answers: dict[str, str],
    urdf: Path | None,
    ask: bool,
    motion: int | None,
) -> None:
    """Write the dataset's files where they are not there, by the ``answers`` and, without ``ask``,
    by values that no analysis depends on, the usual name of a last link and a regular motion;
    ConfigError names what is still open.
    """
    option, known = config.CONF / "dataset" / f"{name}.yaml", {"suggested": True, "ask": ask}
    if not folder.is_dir():
        raise ConfigError("there is no such folder of recordings", file=folder)
    if option.exists() and datasheet.path_of(name).exists():
        print(f"characterize: the dataset {name} is there already and is taken as it is")
        if not [*datasheet.unfilled_keys(config.dataset_values(option))]:
            return
        filling = open_dataset(name, None)
    else:
        filling = open_dataset(name, folder, answers, urdf)
        usual = {"about.subject": f"recordings of {name}", "about.source": str(folder)}
        answers = ({} if ask else _taken(usual, answers)) | answers
    filling.fill(answers, motion=motion, **known)
    if "robot.tool" in filling.left and urdf is not None:
        links = {*re.findall(r'<link\s+name="([^"]+)"', urdf.read_text(errors="replace"))}
        if tools := [tool for tool in TOOLS if tool in links]:
            filling.fill(_taken({"robot.tool": tools[0]}), suggested=True)
    analysed = {key for key in filling.left if key[:6] != "about."}
    if "joint_log.start" in analysed and motion is None and analysed <= {*KEYS}:
        number = _regular_motion(found_motions(filling.draft.values()))
        print(f"characterize: motion {number} is analysed; --motion NUMBER takes another")
        filling.fill({}, motion=number, **known)
    filling.write()
    if left := filling.left:
        message = f"the files cannot tell {', '.join(left)}; run it again with --ask, or with"
        raise ConfigError(f"{message} --set KEY=VALUE for each", file=option)


def _taken(values: dict[str, str], given: Collection[str] = ()) -> dict[str, str]:
    """Print and return the ``values`` that are not ``given``."""
    taken = {key: value for key, value in values.items() if key not in given}
    for key, value in taken.items():
        print(f"characterize: took {key}: {value}; --set {key}=VALUE takes another")
    return taken


def _regular_motion(offered: Sequence[FoundMotion]) -> int:
    """Number of the motion of most repetitions that stays clear of singular poses, among equals of
    most moving joints, then the longest; 1 where there is none.
    """
    if not offered:
        raise ConfigError("the logs hold no motion that repeats", key="joint_log")
    regular = []
    for number, motion in enumerate(offered, 1):
        if motion.least_singular >= REGULAR and len(motion.places) > 1:
            way = np.abs(motion.end - motion.start)
            moving = int(np.sum(way > LEAST_SHARE * way.max()))
            undisturbed = len(motion.places) - len(motion.disturbed)
            regular.append((undisturbed, moving, motion.steps, -number))
    return -max(regular)[-1] if regular else 1


@contextmanager
def _project(name: str, recordings: Path, scale: str) -> Iterator[Path]:
    """Work in a fresh folder with a params.yaml for the dataset, and come back."""
    root, place = Path.cwd(), WORK / name
    option = config.dataset_values(config.CONF / "dataset" / f"{name}.yaml")
    robot = {"urdf": str(Path(option["robot"]["urdf"]).resolve())}
    overrides = {"dataset": {"recordings": str(recordings), "robot": robot}}
    params = {"dataset": name, "scale": scale, "overrides": overrides}
    text = json.dumps(read_yaml(Path("params.yaml")) | params)
    shutil.rmtree(place, ignore_errors=True)
    (place / "data").mkdir(parents=True)
    for linked in LINKED:
        (place / linked).symlink_to(root / linked)
    (place / "params.yaml").write_text(text)
    os.chdir(place)
    try:
        config.write_config(Path("params.yaml"))
        yield place
    finally:
        os.chdir(root)


def _results(
    settings: config.Config,
) -> tuple[list | None, dict[str, pd.DataFrame], dict[str, dict]]:
    """Run the stages up to predict; return their tables and metrics. Where the analysed motion is
    refused, also all motions of the logs, and the tables of the plain models alone.
    """
    dataset = settings.dataset
    try:
        ingest.run("motion")
        Path("data/ingest/depth").mkdir(exist_ok=True)
        track.run()
        for model in settings.models:
            fit.run(model)
        predict.run()
    except PipelineError as error:
        if dataset.joint_log is None:
            raise
        print(f"characterize: plain models alone, as the analysed motion is refused: {error}")
        if not (motions := logged_motions(dataset)):
            message = f"no motion of the logs can be analysed: {error.message}"
            raise ConfigError(message, key="joint_log") from None
        joints, motion = dataset.robot.joints, dataset.motion
        scored = other_motions(motions, joints, motion.rate, pose_noise=motion.pose_noise)
        return motions, dict(scored.tables), {}
    names = [file.stem for file in predict.OUT.glob("*.parquet")]
    tables = {name: contracts.read(name, predict.OUT) for name in names}
    tables["takes"] = contracts.read("takes", track.OUT)
    taken = contracts.read("joints", track.OUT)["take"].nunique()
    metrics = {"motion": {"recorded_takes": int(taken)}}
    for model in settings.models:
        file = fit.OUT / model / "fit.json"
        metrics[f"fit_{model}"] = json.loads(file.read_text())
    return None, tables, metrics
