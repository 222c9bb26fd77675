"""``python -m pipeline assess FILE [--model FILE]``: whether a new recording of the motion behaves
as those did that a model was fitted to.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from pipeline.core import config
from pipeline.core.errors import ConfigError
from pipeline.figures.style import save
from pipeline.models import load
from pipeline.tools.assess.judge import judge
from pipeline.tools.assess.moment_filter import filtered
from pipeline.tools.assess.picture import draw
from pipeline.tools.assess.recording import commanded, new_takes, own_takes
from pipeline.tools.assess.words import said

HERE, EXPORTS, OUT = Path(__file__).parent, Path("data/export"), Path("data/assess")


def run(words: list[str]) -> None:
    """Filter each take in the recording by the exported model, print what is to be said of it, and
    draw it.
    """
    parser = argparse.ArgumentParser(
        prog="python -m pipeline assess", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="as the dataset's others are")
    parser.add_argument(
        "--model", type=Path, metavar="FILE", help=f"that export wrote; else the one in {EXPORTS}"
    )
    arguments = parser.parse_args(words)
    settings = config.sections("assess", HERE / "reads.yaml")
    dataset = settings.dataset
    file = arguments.model or _only_export(dataset.name)
    model = load(file)
    if model.record["dataset"] != dataset.name:
        message = f"the model is one of {model.record['dataset']}, not of the run's {dataset.name}"
        raise ConfigError(message, file=file)
    own, rate = own_takes(), dataset.motion.rate
    takes = new_takes(arguments.file, dataset, own.mean)
    poses = np.concatenate([own.poses, [*takes.values()]])
    innovations = filtered(model, commanded(model, own, rate), poses)
    OUT.mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(takes, len(own.names)):
        # a take of the dataset is held against the others
        others = np.array([*(each != name for each in own.names), *[False] * len(takes)])
        verdict = judge(innovations, number, others, dataset.robot.joints, rate)
        fitted = int(np.sum(own.fitted & others[: len(own.names)]))
        print(said(name, file.name, fitted, verdict))
        save(draw(name, verdict, innovations, number), OUT, name)
        print(f"assess: drawn in {OUT / name}.png")


def _only_export(dataset: str) -> Path:
    files = sorted(EXPORTS.glob(f"{dataset}_*.json"))
    if len(files) != 1:
        there_are = ", ".join(map(str, files)) or f"none of {dataset} in {EXPORTS}"
        message = f"name one exported model by --model; there is {there_are}; export writes one"
        raise ConfigError(message, key="--model")
    return files[0]
