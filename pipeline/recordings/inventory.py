"""Raw files of a dataset: recordings that match a pattern, and the files of each part."""

import hashlib
from collections.abc import Callable, Iterator
from functools import reduce
from pathlib import Path

import pandas as pd

from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.formats.format import is_literal, matching, paths_below

PULLED = Path(
    "data/recordings"
)  # a DVC project of its own: public recordings, pinned by hash
# part → keys of the dataset with the part's files
KEYS = {
    "motion": "trajectory mocap.training mocap.test joint_log.movements encoders.training "
    "encoders.test",
    "depth": "depth.takes depth.intrinsics",
    "force": "force.log.calibration force.configurations",
}


def raw_folder(recordings: str) -> Path:
    """Return the folder of the raw files of ``recordings``: for a folder beside the project the
    folder of its name in data/recordings, if ``dvc --cd data/recordings pull`` has filled it.
    """
    stated = Path(recordings)
    pulled = PULLED / stated.name
    return pulled if stated.parts[:1] == ("..",) and any(raw_files(pulled)) else stated


def raw_files(folder: Path) -> Iterator[Path]:
    """Yield the files below ``folder`` that are neither DVC's nor git's."""
    for file in paths_below(folder):
        if file.is_file() and file.suffix != ".dvc" and file.name != ".gitignore":
            yield file


def take_name(path: Path, raw: Path, pattern: str) -> str:
    """Return the name of the recording at ``path``, which matches ``pattern`` below ``raw``: the
    path's parts from the first to the last wildcard, joined by _, without a file's suffix; without
    wildcard, the last part.
    """
    parts = list(path.relative_to(raw).parts)
    if not path.is_dir():
        parts[-1] = path.stem
    is_open = [not is_literal(part) for part in Path(pattern).parts]
    first, behind = (
        way.index(True) if any(way) else -1 for way in (is_open, is_open[::-1])
    )
    return "_".join(parts[first : len(parts) - max(behind, 0)])


def named_takes(
    raw: Path,
    pattern: str,
    *,
    key: str,
    what: str = "recording",
    wanted: Callable[[Path], bool] = lambda path: True,
) -> dict[str, Path]:
    """Return name → path of the ``wanted`` matches of ``pattern`` below ``raw``, in path order.

    Raises RecordingError for no match, two matches of one name or a name that cannot be printed;
    ConfigError for an invalid pattern.
    """
    named: dict[str, Path] = {}
    for path in filter(wanted, matching(raw, pattern, key=key)):
        if not str(path).isprintable():
            message = "the name has a control character or is not UTF-8; rename it"
            raise RecordingError(message, file=Path(ascii(str(path))[1:-1]))
        name = take_name(path, raw, pattern)
        if name in named:
            other = named[name].relative_to(raw).as_posix()
            message = f"two recordings are named {name!r}, the other is {other}: rename one of them"
            raise RecordingError(
                f"{message}, or narrow the pattern", file=path, key=key
            )
        named[name] = path
    if not named:
        raise RecordingError(f"no {what} matches {pattern!r}", file=raw, key=key)
    return named


def listing(folder: Path) -> pd.DataFrame:
    """Return path, bytes and SHA-256 of all files below ``folder``; RecordingError for no file."""
    if not (files := [*raw_files(folder)]):
        message = "there are no recordings in this folder, or it does not exist; "
        command = f"`dvc --cd {PULLED} pull -R {folder.name}` brings them"
        present = (PULLED / folder.name).is_dir()
        message += command if present else "the datasheet explains how to get them"
        raise RecordingError(message, file=folder)
    rows = []
    for file in files:
        with file.open("rb") as data:
            digest = hashlib.file_digest(data, "sha256").hexdigest()
        rows.append((file.relative_to(folder).as_posix(), file.stat().st_size, digest))
    return pd.DataFrame(rows, columns=["file", "bytes", "sha256"])


def by_place(files: pd.DataFrame) -> pd.DataFrame:
    """Return the table ``raw_files`` of a :func:`listing`: by file or folder of the recordings
    number of files, bytes, and SHA-256 of the paths and hashes of the files.
    """
    files, rows = files.drop_duplicates("file").sort_values("file"), []
    for place, of in files.groupby(files["file"].str.partition("/")[0]):
        lines = "\n".join(of["sha256"] + " " + of["file"]).encode()
        rows.append(
            (place, len(of), of["bytes"].sum(), hashlib.sha256(lines).hexdigest())
        )
    return pd.DataFrame(rows, columns=["place", "files", "bytes", "sha256"])


def other_files(evidence: pd.DataFrame | None, inventory: Path) -> str:
    """Return the differences between the table ``raw_files`` of a run's ``evidence`` and the
    recordings in the file ``inventory`` of its dataset; "" for none, or without inventory.
    """
    if not inventory.is_file():
        return ""
    if evidence is None:
        return "does not name its raw files; run the dataset again"
    present = by_place(pd.read_csv(inventory)).set_index("place")["sha256"]
    before = evidence.set_index("place")["sha256"]
    changed = ", ".join(
        sorted({place for place, _ in {*before.items()} ^ {*present.items()}})
    )
    return changed and f"was written with other files than {inventory} lists: {changed}"


def by_part(files: pd.DataFrame, dataset: Dataset) -> dict[str, pd.DataFrame]:
    """Return part → rows of a :func:`listing`: files of the part (KEYS), and files of no part."""
    raw, claimed = raw_folder(dataset.recordings), pd.DataFrame(index=files.index)
    paths = [raw / name for name in files["file"]]
    for part, keys in KEYS.items():
        places = set()
        for key in keys.split():
            value = reduce(
                lambda at, name: getattr(at, name, None), key.split("."), dataset
            )
            if isinstance(value, dict):  # of arrangements
                value = [one.file for one in value.values()]
            for pattern in [value] if isinstance(value, str) else value or ():
                places |= {*matching(raw, pattern, key=f"dataset.{key}")}
        claimed[part] = [not places.isdisjoint([file, *file.parents]) for file in paths]
    return {part: files[claimed[part] | ~claimed.any(axis=1)] for part in KEYS}
