"""Raw files of a dataset: recordings that match a pattern, and the files of each part."""

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd

from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.formats.format import is_literal, matching, paths_below

# a DVC project of its own: public recordings, pinned by hash
PULLED = Path("data/recordings")
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
    beside = stated.parts[:1] == ("..",)
    return pulled if beside and any(raw_files(pulled)) else stated


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
    literal = [is_literal(words) for words in Path(pattern).parts]
    if all(literal):
        return parts[-1]
    before = literal.index(False)
    behind = literal[::-1].index(False)
    return "_".join(parts[before : len(parts) - behind])


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
            earlier = named[name].relative_to(raw).as_posix()
            raise RecordingError(
                f"two recordings are named {name!r}, the other is {earlier}: rename one of "
                "them, or narrow the pattern",
                file=path,
                key=key,
            )
        named[name] = path
    if not named:
        raise RecordingError(f"no {what} matches {pattern!r}", file=raw, key=key)
    return named


def listing(folder: Path) -> pd.DataFrame:
    """Return path, bytes and SHA-256 of all files below ``folder``; RecordingError for no file."""
    files = [*raw_files(folder)]
    if not files:
        remedy = "the datasheet explains how to get them"
        if (PULLED / folder.name).is_dir():
            remedy = f"`dvc --cd {PULLED} pull -R {folder.name}` brings them over the network"
        message = "there are no recordings in this folder, or it does not exist"
        raise RecordingError(f"{message}; {remedy}", file=folder)
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
    files = files.drop_duplicates("file").sort_values("file")
    place_of_file = files["file"].str.partition("/")[0]
    rows = []
    for place, below in files.groupby(place_of_file):
        lines = below["sha256"] + " " + below["file"]
        digest = hashlib.sha256("\n".join(lines).encode()).hexdigest()
        rows.append((place, len(below), below["bytes"].sum(), digest))
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
    changed = {*before.items()} ^ {*present.items()}
    if not changed:
        return ""
    places = {place for place, _ in changed}
    names = ", ".join(sorted(places))
    return f"was written with other files than {inventory} lists: {names}"


def by_part(files: pd.DataFrame, dataset: Dataset) -> dict[str, pd.DataFrame]:
    """Return part → rows of a :func:`listing`: files of the part (KEYS), and files of no part."""
    raw = raw_folder(dataset.recordings)
    paths = [raw / name for name in files["file"]]
    claimed = pd.DataFrame(index=files.index)
    for part_name, keys in KEYS.items():
        places = _places(raw, dataset, keys.split())
        claimed[part_name] = [
            not places.isdisjoint([file, *file.parents]) for file in paths
        ]
    unclaimed = ~claimed.any(axis=1)
    return {name: files[claimed[name] | unclaimed] for name in KEYS}


def _places(raw: Path, dataset: Dataset, keys: list[str]) -> set[Path]:
    """Return the files and folders below ``raw`` that the options ``keys`` name."""
    places = set()
    for key in keys:
        for pattern in _patterns(dataset, key):
            places.update(matching(raw, pattern, key=f"dataset.{key}"))
    return places


def _patterns(dataset: Dataset, key: str) -> list[str]:
    """Return the patterns of file names in the option ``key`` of ``dataset``."""
    value = dataset
    for name in key.split("."):
        value = getattr(value, name, None)
    if value is None:
        return []
    if isinstance(value, str):
        return [value]
    if isinstance(value, dict):  # of arrangements of robots
        return [configuration.file for configuration in value.values()]
    return [*value]
