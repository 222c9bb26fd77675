"""Joint logs as named arrays: NumPy archives (.npz), MATLAB files (.mat up to version 7.2, with
dotted paths into structs) and Parquet. One array has the times (N,), one array per signal the
values (N, joints); vectors ``q_0``, ``q_1``, … also form one array. A separate process reads the
file, since a damaged file can crash the library and a small file can decompress to any size.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import UNITS, unit_in_name
from pipeline.formats.format import Format, Head, Kind, begins, read_alone
from pipeline.formats.joints import names as meanings
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, increasing
from pipeline.formats.joints.values import signals_by_values

HDF5 = (b"MATLAB 7.3", b"\x89HDF")  # HDF5 files, which may also have the suffix .mat
WANTED = {"actual": "measured angles", "target": "commanded angles"}
MEMBER = slice(30, 286)  # bytes of a ZIP file that contain the name of its first member
Arrays = dict[str, np.ndarray]


def read_arrays(file: Path, options: LogOptions) -> JointLog:
    """Return the signals that ``options`` name in ``file``, by default the measured and commanded
    angles by their array names. ``ARRAY:COLUMN`` (from 0) names one column of an array. Raises
    RecordingError for a damaged file; with the array and row (from 0), for a number that is not
    finite or a time that does not increase; with the option, for a missing or ambiguous array.
    """
    content = _content(file)
    recordings = content.recordings()
    if len(recordings) > 1:
        if options.recording is None and not options.guess:
            raise RecordingError(
                f"the file holds {len(recordings)} recordings: write each to a file of its own",
                file=file,
            )
        content.choose_rows(recordings[options.recording or 0])
    clocks = meanings.clocks_of(content.vectors)
    content.stand_upright({len(content.arrays[name]) for name in clocks})
    named = clocks if isinstance(options.time, int) else [options.time]
    clock = named[0] if len(named) == 1 else None
    time = None
    time_unit = ""
    if clock is not None:
        time_unit = "s" if clock in content.dated else _unit("time", named, file)
        factor = UNITS["time"][time_unit or options.time_unit]
        time = content.numbers("time", named)[:, 0] * factor

    stated = {name: labels for name, labels in options.signals.items() if labels}
    wanted = options.signals or ("actual", "target")
    guesses = {}
    guessed = {}
    advice = ""
    if {*wanted} - {*stated}:
        signals_by_name, reasons = content.signals(time)
        if reasons and not meanings.possibly_speed(signals_by_name["target"]):
            if options.guess:
                guesses = reasons
                guessed = signals_by_name
            else:
                suggested = str(signals_by_name).replace("'", "")
                advice = f". {'; '.join(reasons.values())}: signals may be {suggested}"
                del signals_by_name["target"]
        stated = signals_by_name | stated

    signals = {}
    angle_units = []
    for name in wanted:
        labels = stated.get(name, ())
        unit = _unit("angle", labels, file)
        factor = UNITS["angle"][unit or options.angle_unit]
        signals[name] = content.numbers(name, labels, advice) * factor
        angle_units.append(unit)
    if time is None:
        if options.time is not None:
            content.numbers("time", ())  # raises, since no array or several are times
        longest = max(len(rows) for rows in signals.values())
        time = np.arange(longest) / options.rate
    _require_rows_at_times(signals, time, file, clock)
    log = JointLog(
        time,
        signals,
        {},
        content.joint_names({rows.shape[1] for rows in signals.values()}),
        guesses=guesses,
        arrays=guessed,
        clock=clock or "",
        time_unit="s" if time_unit else "",
        angle_unit="rad" if all(angle_units) else "",
        recordings=len(recordings),
    )
    return increasing(log, lambda row: {"file": file, "array": clock, "row": row})


@dataclass
class _Content:
    """Arrays of a file by name: numbers, and words such as joint names."""

    file: Path
    arrays: Arrays  # numbers
    words: dict[str, list[str]]
    dated: set[str]  # names of dates and durations, in s
    columns: Arrays = field(default_factory=dict)  # name or ARRAY:COLUMN → (N,)

    @property
    def vectors(self) -> Arrays:
        """Arrays (N,)."""
        return {name: array for name, array in self.arrays.items() if array.ndim == 1}

    def recordings(self) -> list[slice]:
        """Return the rows of each recording in the file, by a vector that numbers them: whole
        numbers that grow where the only clock starts again; one for other files.
        """
        clocks = meanings.named_like("time", self.vectors)
        if len(clocks) != 1:
            return [slice(None)]
        time = self.vectors[clocks[0]]
        starts = np.flatnonzero(np.diff(time) < 0) + 1
        for name, numbers in self.vectors.items():
            is_index = meanings.RECORDING & {*meanings.words_of(name)}
            if not is_index or len(numbers) != len(time) or not len(starts):
                continue
            if np.array_equal(np.flatnonzero(np.diff(numbers) > 0) + 1, starts):
                ends = [0, *starts.tolist(), len(time)]
                return [slice(first, end) for first, end in pairwise(ends)]
        return [slice(None)]

    def choose_rows(self, rows: slice) -> None:
        """Keep only the ``rows`` of one recording of all arrays with a row per time."""
        clock = meanings.named_like("time", self.vectors)[0]
        length = len(self.arrays[clock])
        for name, array in self.arrays.items():
            if array.ndim and len(array) == length:
                self.arrays[name] = array[rows]

    def join_vectors(self) -> None:
        """Add an array (N, joints) of vectors whose names differ in a number or a joint's name."""
        vectors = self.vectors
        for name, labels in meanings.columns_by_name([*vectors]).items():
            group = [vectors[label] for label in labels]
            equal = len({len(vector) for vector in group}) == 1
            if name not in self.arrays and len(group) > 1 and equal:
                self.arrays[name] = np.column_stack(group)
                if meanings.states_joints(labels):
                    self.words["joint_names"] = meanings.joint_parts(labels)

    def stand_upright(self, lengths: set[int]) -> None:
        """Transpose arrays with one row per joint beside times of ``lengths``; list the columns."""
        for name, array in self.arrays.items():
            if array.ndim == 2:
                rows, joints = array.shape
                if joints in lengths and rows not in lengths:
                    array = array.T
                    self.arrays[name] = array
                for column, numbers in enumerate(array.T):
                    self.columns[f"{name}:{column}"] = numbers
            elif array.ndim == 1:
                self.columns[name] = array

    def signals(
        self,
        time: np.ndarray | None,
    ) -> tuple[dict[str, list[str]], dict[str, str]]:
        """Return :func:`names.signals_of_groups` of the arrays (N, joints), or of the vectors of a
        single joint; of a single array without a name, the columns by their values.
        """
        tables = {}
        for name, array in self.arrays.items():
            if array.ndim == 2:
                tables[name] = array.astype(float)
        if not tables:
            return meanings.signals_of([*self.vectors])
        groups = {name: [name] for name in tables}
        # damaged numbers may be huge or NaN
        with np.errstate(over="ignore", invalid="ignore"):
            signals, guessed = meanings.signals_of_groups(groups, tables, time)
            if signals or len(tables) > 1:
                return signals, guessed
            return _signals_in_array(*tables.popitem(), time)

    def numbers(
        self,
        quantity: str,
        names: Sequence[object],
        advice: str = "",
    ) -> np.ndarray:
        """Return the columns (N, …) of the arrays or columns ``names``; RecordingError with the
        ``advice`` unless all are there, of one length and finite.
        """
        labels = []
        for name in map(str, names):
            array = self.arrays.get(name)
            if array is not None and array.ndim == 2:
                labels += [f"{name}:{column}" for column in range(array.shape[1])]
            else:
                labels.append(name)
        columns = [self.columns[label] for label in labels if label in self.columns]
        lengths = {len(column) for column in columns}
        if not labels or len(columns) < len(labels) or len(lengths) > 1:
            raise self._lacks(quantity, labels, advice)
        values = np.column_stack(columns).astype(float)
        invalid = ~np.isfinite(values)
        if invalid.any():
            row, column = np.argwhere(invalid)[0].tolist()
            label = labels[column]
            message = f"{label} holds {values[row, column]}, not a finite number"
            raise RecordingError(message, file=self.file, array=label, row=row)
        return values

    def _lacks(
        self,
        quantity: str,
        labels: Sequence[str],
        advice: str,
    ) -> RecordingError:
        """Return the error for a ``quantity`` whose ``labels`` are no arrays of one length."""
        shapes = [
            f"{name} {array.shape}" for name, array in sorted(self.arrays.items())
        ]
        meaning = WANTED.get(quantity, quantity)
        alike = meanings.named_like(quantity, self.arrays)
        option = "time" if quantity == "time" else f"signals ({quantity}: [ARRAY])"
        present = self.arrays.keys() | self.words.keys()
        unknown = [label for label in labels if label.partition(":")[0] not in present]
        if unknown:
            fault = f"{quantity} is named {', '.join(unknown)}, which the file lacks; name an array"
        elif labels:
            fault = f"the {quantity} must be arrays with one row of numbers per time, found "
            fault += f"{', '.join(labels)}; name the array"
        elif len(alike) > 1:
            fault = f"{len(alike)} arrays could be the {meaning}, {', '.join(alike)}; name one in "
            fault += option
        else:
            fault = (
                f"no name of an array states the {meaning}; name the array in {option}"
            )
        return RecordingError(
            f"{fault}, or its columns as ARRAY:COLUMN{advice}. The file has "
            f"{', '.join(shapes) or 'no arrays'}",
            file=self.file,
            key=f"{OPTION}.{option.partition(' ')[0]}",
        )

    def joint_names(self, numbers: set[int]) -> tuple[str, ...]:
        """Return the joints' names in an array of words, if all signals have as many joints."""
        for name, names in self.words.items():
            if meanings.is_names(name) and {len(names)} == numbers:
                return tuple(names)
        return ()


def _signals_in_array(
    name: str,
    array: np.ndarray,
    time: np.ndarray | None,
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return :func:`signals_by_values` of the columns of the ``array`` (N, columns) ``name``."""
    places, reasons = signals_by_values(dict(enumerate(array.T)), time)
    signals = {}
    for signal, columns in places.items():
        signals[signal] = [f"{name}:{column}" for column in columns]
    return signals, reasons


def _content(file: Path) -> _Content:
    """Return the arrays of ``file``, read in a separate process."""
    head = Head.read(file)
    if head.content.startswith(HDF5):
        raise RecordingError("version 7.3 is not read; save it with -v7", file=file)
    reader = _npz
    for recognises, read in READERS.values():
        if recognises(head):
            reader = read
            break
    arrays = read_alone(reader, Path(file), file=file, advice="save it again")
    size = sum(array.size for array in arrays.values()) * 8 / MIB
    require("memory_mib", size, "MiB of numbers", file)

    content = _Content(file, {}, {}, set())
    for name, array in arrays.items():
        if array.dtype.kind == "U":
            content.words[name] = [str(word) for word in array]
            continue
        if array.dtype.kind in "mM":  # their type is a unit; dates in s since 1970
            content.dated.add(name)
            since = array - np.zeros(1, array.dtype)
            array = since / np.timedelta64(1, "s")
        content.arrays[name] = array
    content.join_vectors()
    return content


def _require_rows_at_times(
    signals: Arrays,
    time: np.ndarray,
    file: Path,
    clock: str | None,
) -> None:
    """Raise RecordingError unless each of the ``signals`` has a row at each ``time``."""
    lengths = {name: len(rows) for name, rows in signals.items()}
    if {*lengths.values()} != {len(time)}:
        rows = ", ".join(f"{count} of {name}" for name, count in lengths.items())
        message = (
            f"{len(time)} times for {rows} angles; save one row of joints for each time"
        )
        raise RecordingError(message, file=file, array=clock)


def _unit(kind: str, labels: Sequence[object], file: Path) -> str:
    """Return the unit of the ``kind`` that is a word of all names of arrays, else ""."""
    units = set()
    for label in labels:
        array, _, _ = str(label).partition(":")
        units.add(unit_in_name(array, kind))
    for unit in units.intersection(UNITS[f"unread_{kind}"]):
        convert = " or ".join(UNITS[kind])
        message = f"{labels[0]} is in {unit} by its name: convert it to {convert}"
        raise RecordingError(message, file=file)
    return units.pop() if len(units) == 1 else ""


def _npz(file: Path) -> Arrays:
    """Return the arrays of a NumPy archive; pickled objects are never loaded."""
    arrays: Arrays = {}
    with np.load(file, allow_pickle=False) as archive:
        for name in archive.files:
            try:
                arrays[name] = _numeric(archive[name])
            except ValueError as error:
                if "pickle" not in str(error):
                    raise
                arrays[name] = np.empty(())
    return arrays


def _numeric(value: object) -> np.ndarray:
    """Return ``value`` as numbers, dates, durations or words; shape () for anything else."""
    if not isinstance(value, np.ndarray):
        return np.empty(())
    if value.dtype.kind == "O" and value.ndim == 1:
        if {type(item) for item in value} == {str}:
            return value.astype(str)
        shapes = {np.shape(row) for row in value}
        if len(shapes) == 1 and shapes != {()}:
            return _numeric(np.stack(value))
    return value if value.dtype.kind in "fiumMU" else np.empty(())


def _mat(file: Path) -> Arrays:
    """Return the matrices of a MATLAB file; ``rec.q`` is the matrix ``q`` in the struct ``rec``."""
    content = loadmat(file, simplify_cells=True)
    opaque = "None" in content  # an object, such as a table or a timeseries
    variables = {}
    for name, value in content.items():
        if not name.startswith("__") and name != "None":
            variables[name] = value
    arrays = dict(_flatten("", variables))
    if opaque and not arrays:
        raise RecordingError(
            "a table or another object of MATLAB is not read: save its columns as arrays, or "
            "as a struct (table2struct(T, 'ToScalar', true))",
            file=file,
        )
    for name, array in arrays.items():
        # MATLAB stores a vector as a matrix with one row or one column
        arrays[name] = array.ravel() if 1 in array.shape else array
    return arrays


def _flatten(
    path: str,
    struct: Mapping[str, object],
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and numbers of the fields of a ``struct``, with ``path`` before the names."""
    for name, value in struct.items():
        if isinstance(value, Mapping):
            yield from _flatten(f"{path}{name}.", value)
        elif _are_structs(value):
            yield from _flatten_structs(f"{path}{name}", value)
        else:
            yield f"{path}{name}", _numeric(value)


def _are_structs(value: object) -> bool:
    """Return whether ``value`` is an array of structs with the same fields."""
    if not isinstance(value, np.ndarray | list) or not len(value):
        return False
    fields = {tuple(item) if isinstance(item, Mapping) else None for item in value}
    return None not in fields and len(fields) == 1


def _flatten_structs(
    path: str,
    structs: Sequence[Mapping[str, object]],
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of ``structs``: one row per struct if a field is a number in all, such as a
    time, else the arrays of each struct by its number from 1.
    """
    fields = {}
    for name in structs[0]:
        fields[name] = [np.asarray(struct[name]) for struct in structs]
    rows = any(all(v.ndim == 0 for v in values) for values in fields.values())
    if not rows:
        for number, struct in enumerate(structs, start=1):
            yield from _flatten(f"{path}({number}).", struct)
        return
    for name, values in fields.items():
        if len({value.shape for value in values}) == 1:
            yield f"{path}.{name}", _numeric(np.stack(values))


def _parquet(file: Path) -> Arrays:
    """Return the columns of numbers, dates or words."""
    from pyarrow import parquet

    table = parquet.read_table(file)
    table.validate()
    columns = {name: _numeric(table[name].to_numpy()) for name in table.column_names}
    return {name: values for name, values in columns.items() if values.ndim}


READERS = {  # name of the format: recogniser, reader of the arrays
    "MATLAB file of joints": (  # a file of version 4 has no leading mark
        lambda head: begins(b"MATLAB 5.0 MAT-file", HDF5[0])(head) or head.suffix == ".mat", _mat),
    "NumPy archive of joints": (
        lambda head: begins(b"PK\x03\x04")(head) and b".npy" in head.content[MEMBER], _npz),
    "Parquet table of joints": (begins(b"PAR1"), _parquet),
}  # fmt: skip
FORMAT = tuple(
    Format(name, Kind.JOINTS, read_arrays, recognises)
    for name, (recognises, _) in READERS.items()
)
