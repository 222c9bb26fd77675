"""One stage in this process, and the processor time in s that numba takes in it to compile, written
to the file ANSWER: ``python first_use.py ANSWER STAGE [ITEM]`` in a copy of the project.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import pipeline.__main__  # before numpy: it fixes the arithmetic

from numba.core import event  # isort: skip


class Compiler(event.Listener):
    """Processor time that numba takes to compile; a function that needs others compiles them
    inside.
    """

    def __init__(self) -> None:
        self.seconds, self._begun = 0.0, []

    def on_start(self, event: event.Event) -> None:
        self._begun.append(time.process_time())

    def on_end(self, event: event.Event) -> None:
        begin = self._begun.pop()
        if not self._begun:
            self.seconds += time.process_time() - begin


def main(answer: Path) -> None:
    """What `python -m pipeline` does, the import of the stage included: functions of a known
    signature are compiled by it.
    """
    compiler = Compiler()
    with event.install_listener("numba:compile", compiler):
        if pipeline.__main__.main() != 0:
            sys.exit(1)
    answer.write_text(repr(compiler.seconds))


if __name__ == "__main__":
    main(Path(sys.argv.pop(1)))
