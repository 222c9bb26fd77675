"""The faults of the study, read from ``faults.yaml``."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from pathlib import Path

from pipeline.core.typed_yaml import read_yaml
from pipeline.studies.faults.fault import Fault, Infliction, in_all, in_file, in_files

FILE = Path(__file__).with_name("faults.yaml")
MOTION_CAPTURE, DEPTH, FORCE = INSTRUMENTS = "motion capture", "depth camera", "force transducer"
WHERE = {"one": in_file, "each": in_files, "all": in_all}


def read_faults(file: Path = FILE) -> dict[str, Fault]:
    """The faults of ``file`` by name, instrument by instrument, those of any text first."""
    content = read_yaml(file)
    faults = [
        fault
        for name, log in content["logs"].items()
        for fault in text_faults(name, log, content["text"])
    ]
    faults += [_fault(name, entry) for name, entry in content["faults"].items()]
    ordered = sorted(faults, key=lambda fault: INSTRUMENTS.index(fault.instrument))
    return {fault.name: fault for fault in ordered}


def text_faults(name: str, log: dict, text: dict) -> list[Fault]:
    """The faults that the ``log`` called ``name`` can have as any ``text`` can: entries of
    ``logs`` and ``text`` of the file.
    """
    return [
        _fault(
            f"{name}: {change}",
            {"instrument": log["instrument"], "files": log["files"], **graded}
            | {"change": f"text.{change.replace(' ', '_')}"}
            | log["owed"].get(change, text["owed"]),
        )
        for change, graded in text["changes"].items()
    ]


def _fault(name: str, entry: dict) -> Fault:
    return Fault(
        name=name,
        instrument=entry["instrument"],
        inflict=_infliction(entry),
        severity=entry["severity"],
        levels=tuple(entry["levels"]),
        expected=tuple(entry["expected"]),
        rule=entry["rule"],
        counted=tuple(entry.get("counted", ())),
    )


def _infliction(entry: dict) -> Infliction:
    module, _, function = entry["change"].partition(".")
    change = getattr(import_module(f"pipeline.studies.faults.{module}"), function)
    arguments = [a.encode() if isinstance(a, str) else a for a in entry.get("arguments", ())]
    return WHERE[entry.get("where", "one")](entry.get("files", "*"), partial(change, *arguments))


FAULTS = read_faults()
