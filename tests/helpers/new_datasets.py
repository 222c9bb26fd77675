"""Datasets that new-dataset writes in tests, and takes of motion capture to write them from."""

from pathlib import Path

from motive_files import START, random_take
from omegaconf import OmegaConf
from source_code import ROOT

from pipeline.__main__ import tool_call
from pipeline.configuration import config, datasheet
from pipeline.formats.motion.motive import write_motive

UR5 = ROOT / "pipeline/arm/ur5.urdf"


def run(*words: object) -> None:
    tool_call("new_dataset", [*map(str, words)])()


def write_takes(
    folder: Path,
    *names: str,
    frames: int = 9,
    bodies: bool = False,
) -> None:
    """Takes of motion capture, of markers or of rigid bodies alone."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        take = random_take(frames, body=bodies)
        if bodies:
            take.markers.clear()
        write_motive(folder / f"{name}.csv", take, start=START)


def written(name: str = "lab") -> tuple[dict, dict]:
    """Datasheet and option file, as plain data."""
    files = datasheet.path_of(name), config.CONF / f"dataset/{name}.yaml"
    return tuple(OmegaConf.to_container(OmegaConf.load(file)) for file in files)


def unfilled(name: str = "lab") -> set[str]:
    return {key for values in written(name) for key in datasheet.unfilled_keys(values)}


def contains(values: dict, part: dict) -> bool:
    return {key: values[key] for key in part} == part
