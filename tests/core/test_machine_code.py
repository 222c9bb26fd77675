"""Inner functions have no machine code of their own, and what is kept is loaded alone."""

from __future__ import annotations

import subprocess
import sys

from compiled_calls import from_python
from project_copy import ROOT

from pipeline.core.machine_code import Part, Whole
from pipeline.models.serial import joints_at, rows_of_room

# what numba imports before it compiles anything
REGISTRY = "numba.np.random.generator_methods"
PROGRAM = f"""
import sys
from pipeline.models.serial import rows_of_room
known = "{REGISTRY}" in sys.modules
print(sum(rows_of_room.stats.cache_hits.values()), known, rows_of_room(3, 3))
"""


def test_an_inner_function_has_no_machine_code_but_within_those_that_call_it():
    assert from_python(joints_at)(3, 3) > 0
    (part,) = joints_at.overloads.values()
    assert isinstance(part.library, Part)
    assert part.library.get_pointer_to_function(part.fndesc.llvm_func_name) == 0
    # the control: one with a way in
    assert rows_of_room(3, 3) > 0
    (whole,) = rows_of_room.overloads.values()
    assert isinstance(whole.library, Whole)
    assert whole.library.get_pointer_to_function(whole.fndesc.llvm_func_name) != 0


def test_what_is_kept_is_loaded_without_all_that_numba_can_compile():
    # what imports it keeps it, as this module does
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["1", "False", str(rows_of_room(3, 3))]
