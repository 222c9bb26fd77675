"""The emulated machine: drivers in the order of what they need, and what the guest computes."""

from __future__ import annotations

import json
import shlex
import sys

import emulated
import equal_bytes
import pytest
from emulated import in_order, libraries, run
from equal_bytes import SETTINGS

V4 = [one for one in SETTINGS if one.level == "x86-64-v4"]


def driver(folder, name, depends):
    """A file that says as a kernel's module does what it depends on."""
    file = folder / f"{name}.ko"
    file.write_bytes(b"license=GPL\0depends=" + depends.encode() + b"\0name=x\0")
    return file


def test_drivers_stand_after_those_that_they_need_and_once(tmp_path):
    needs = {"disk": "bus,check", "bus": "core", "core": "", "check": "core"}
    files = {name: driver(tmp_path, name, depends) for name, depends in needs.items()}
    assert in_order(files, ("disk", "bus")) == ["core", "bus", "check", "disk"]


def test_a_driver_that_the_kernel_does_not_have_is_refused(tmp_path):
    with pytest.raises(KeyError, match="core"):
        in_order({"disk": driver(tmp_path, "disk", "core")}, ("disk",))


def test_the_guest_has_the_c_library_that_python_asks_for(tmp_path):
    assert any(path.name.startswith("libc.so") for path in libraries(tmp_path))


def test_the_guest_computes_the_settings_of_the_levels_that_are_lacking(tmp_path, monkeypatch):
    port = tmp_path / "port"
    monkeypatch.setattr(emulated, "PORT", str(port))
    line = next(one for one in run(V4).splitlines() if one.startswith(sys.executable))
    monkeypatch.setattr(equal_bytes, "measured", lambda *asked: [*map(str, asked)])
    exec(shlex.split(line)[2], {})
    assert json.loads(port.read_text()) == [str(V4), "/levels"]


def test_nothing_is_built_where_all_levels_run_or_the_emulator_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr(emulated, "lacking", list)
    with pytest.raises(RuntimeError, match="make bench"):
        emulated.main(tmp_path / "run")
    monkeypatch.setattr(emulated, "lacking", lambda: V4)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RuntimeError, match="no Bochs"):
        emulated.main(tmp_path / "run")
    assert not (tmp_path / "run").exists()
