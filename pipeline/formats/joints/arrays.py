"""Joint logs as named arrays: NumPy archives (.npz), MATLAB files (.mat up to version 7.2, with
dotted paths into structs) and Parquet. One array has the times (N,), one array per signal the
values (N, joints); vectors ``q_0``, ``q_1``, … also form one array. A separate process reads the
file, since a damaged file can crash the library and a small file can decompress to any size.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import UNITS, unit_in_name
from pipeline.formats.format import Format, Head, Kind, begins, read_alone
from pipeline.formats.joints import names as meanings
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, increasing

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
    head = Head.read(file)
    if head.content.startswith(HDF5):
        raise RecordingError("version 7.3 is not read; save it with -v7", file=file)
    read = next((read for is_one, read in READERS.values() if is_one(head)), _npz)
    data = read_alone(read, Path(file), file=file, advice="save it again")
    require(
        "memory_mib",
        sum(one.size for one in data.values()) * 8 / MIB,
        "MiB of numbers",
        file,
    )
    words = {
        name: [*map(str, one)] for name, one in data.items() if one.dtype.kind == "U"
    }
    dated = {
        name for name, one in data.items() if one.dtype.kind in "mM"
    }  # their type is a unit
    for name in dated:  # s, dates since 1970
        data[name] = (data[name] - np.zeros(1, data[name].dtype)) / np.timedelta64(
            1, "s"
        )
    data = {name: one for name, one in data.items() if name not in words}
    vectors = {name: one for name, one in data.items() if one.ndim == 1}
    for name, group in meanings.columns_by_name([*vectors]).items():
        own = [vectors[label] for label in group]
        if name not in data and len(own) > 1 and len({*map(len, own)}) == 1:
            data[name] = np.column_stack(own)
            if meanings.states_joints(group):
                words["joint_names"] = meanings.joint_parts(group)
    times, advice = meanings.clocks_of(vectors), ""
    lengths = {len(data[name]) for name in times}
    groups, columns = {}, {}  # array → labels of its columns, label → numbers (N,)
    for name, one in data.items():
        if one.ndim == 2 and one.shape[1] in lengths and one.shape[0] not in lengths:
            data[name] = one = one.T  # one row per joint beside a time of that length
        if one.ndim in (1, 2):
            own = (
                [f"{name}:{j}" for j in range(one.shape[1])]
                if one.ndim == 2
                else [name]
            )
            groups[name], columns = (
                own,
                columns | dict(zip(own, np.atleast_2d(one.T), strict=True)),
            )

    def numbers(quantity: str, names: Sequence[object]) -> np.ndarray:
        labels = [
            label for name in map(str, names) for label in groups.get(name, [name])
        ]
        chosen = [columns[label] for label in labels if label in columns]
        if not labels or len(chosen) < len(labels) or len({*map(len, chosen)}) > 1:
            shapes = [f"{name} {one.shape}" for name, one in sorted(data.items())]
            if labels:
                message = f"the {quantity} must be arrays with one row of numbers per time, found "
                message += f"{', '.join(labels)}; name the array, or its columns as "
            else:
                message = f"no name of an array states the {WANTED.get(quantity, quantity)}; name "
                message += (
                    f"the array in signals ({quantity}: [ARRAY]), or its columns as "
                )
            message += (
                f"ARRAY:COLUMN{advice}. The file has {', '.join(shapes) or 'no arrays'}"
            )
            key = f"{OPTION}.{'time' if quantity == 'time' else 'signals'}"
            raise RecordingError(message, file=file, key=key)
        values = np.column_stack(chosen).astype(float)
        if (invalid := ~np.isfinite(values)).any():
            row, column = np.argwhere(invalid)[0].tolist()
            message = (
                f"{labels[column]} holds {values[row, column]}, not a finite number"
            )
            raise RecordingError(message, file=file, array=labels[column], row=row)
        return values

    named = times if isinstance(options.time, int) else [options.time]
    clock, time, second = (named[0] if len(named) == 1 else None), None, ""
    if clock is not None:
        second = "s" if clock in dated else _unit("time", named, file)
        time = numbers("time", named)[:, 0] * UNITS["time"][second or options.time_unit]
    chosen = {name: labels for name, labels in options.signals.items() if labels}
    wanted = options.signals or ("actual", "target")
    guesses, guessed_arrays = {}, {}
    if {*wanted} - {*chosen}:
        tables = {
            name: data[name].astype(float) for name in groups if data[name].ndim == 2
        }
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # damaged numbers may be huge or NaN
            found, guessed = meanings.signals_of_groups(
                {n: [n] for n in tables}, tables, time
            )
        doubtful = guessed and not meanings.possibly_speed(found["target"])
        if doubtful and options.guess:
            guesses, guessed_arrays = guessed, found
        elif doubtful:
            advice = f". {'; '.join(guessed.values())}: signals may be {found}".replace(
                "'", ""
            )
            del found["target"]
        chosen = found | chosen
    units = {name: _unit("angle", chosen.get(name, ()), file) for name in wanted}
    signals = {}
    for name, unit in units.items():
        factor = UNITS["angle"][unit or options.angle_unit]
        signals[name] = numbers(name, chosen.get(name, ())) * factor
    lengths = {name: len(rows) for name, rows in signals.items()}
    if time is None:
        time = np.arange(max(lengths.values())) / options.rate
        if options.time is not None:
            numbers("time", ())
    if {*lengths.values()} != {len(time)}:
        rows = ", ".join(f"{count} of {name}" for name, count in lengths.items())
        message = (
            f"{len(time)} times for {rows} angles; save one row of joints for each time"
        )
        raise RecordingError(message, file=file, array=clock)
    width = {rows.shape[1] for rows in signals.values()}
    stated = (
        tuple(w) for n, w in words.items() if meanings.is_names(n) and {len(w)} == width
    )
    units = {
        "time_unit": "s" * (second != ""),
        "angle_unit": "rad" * all(units.values()),
    }
    units |= {"guesses": guesses, "arrays": guessed_arrays, "clock": clock or ""}
    log = JointLog(time, signals, {}, next(stated, ()), **units)
    return increasing(log, lambda row: {"file": file, "array": clock, "row": row})


def _unit(kind: str, labels: Sequence[object], file: Path) -> str:
    """Return the unit of the ``kind`` that is a word of all names of arrays, else ""."""
    stated = {unit_in_name(str(label).partition(":")[0], kind) for label in labels}
    if unread := stated & {*UNITS[f"unread_{kind}"]}:
        message = f"{labels[0]} is in {unread.pop()} by its name: convert it to "
        raise RecordingError(message + " or ".join(UNITS[kind]), file=file)
    return stated.pop() if len(stated) == 1 else ""


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
    kind = value.dtype.kind if isinstance(value, np.ndarray) else ""
    if kind == "O" and value.ndim == 1 and {*map(type, value)} == {str}:
        return value.astype(str)
    if kind == "O" and value.ndim == 1 and len({np.shape(row) for row in value}) == 1:
        return _numeric(np.stack(value)) if np.shape(value[0]) else np.empty(())
    return value if kind and kind in "fiumMU" else np.empty(())


def _mat(file: Path) -> Arrays:
    """Return the matrices of a MATLAB file; ``rec.q`` is the matrix ``q`` in the struct ``rec``."""
    content = loadmat(file, simplify_cells=True)
    arrays = dict(_flatten("", content))
    if "None" in content and not arrays:  # an object, such as a table or a timeseries
        message = "a table or another object of MATLAB is not read: save its columns as arrays, or "
        message += "as a struct (table2struct(T, 'ToScalar', true))"
        raise RecordingError(message, file=file)
    # MATLAB stores a vector as a matrix with one row or one column
    return {
        name: one.ravel() if 1 in one.shape else one for name, one in arrays.items()
    }


def _flatten(
    path: str, struct: Mapping[str, object]
) -> Iterator[tuple[str, np.ndarray]]:
    for name, value in struct.items():
        if isinstance(value, Mapping):
            yield from _flatten(f"{path}{name}.", value)
        elif _are_structs(value):
            yield from _flatten_structs(f"{path}{name}", value)
        elif path or not (
            name.startswith("__") or name == "None"
        ):  # "None": an opaque object
            yield f"{path}{name}", _numeric(value)


def _are_structs(value: object) -> bool:
    """Return whether ``value`` is an array of structs with the same fields."""
    if not isinstance(value, np.ndarray | list) or not len(value):
        return False
    fields = {tuple(item) if isinstance(item, Mapping) else None for item in value}
    return None not in fields and len(fields) == 1


def _flatten_structs(
    path: str, structs: Sequence[Mapping[str, object]]
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of ``structs``: one row per struct if a field is a number in all, such as a
    time, else the arrays of each struct by its number from 1.
    """
    rows = any(all(np.ndim(s[name]) == 0 for s in structs) for name in structs[0])
    if not rows:
        for number, struct in enumerate(structs, start=1):
            yield from _flatten(f"{path}({number}).", struct)
        return
    for name in structs[0]:
        values = [np.asarray(struct[name]) for struct in structs]
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
    Format(n, Kind.JOINTS, read_arrays, is_one) for n, (is_one, _) in READERS.items()
)
