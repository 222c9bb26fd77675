"""One stage in this process, and the processor time in s that it takes to import, Python's own
start and what functions import while they run included, written to the file ANSWER: ``python
import_time.py ANSWER STAGE [ITEM]`` in a copy of the project.
"""

from __future__ import annotations

import sys
import time
from importlib import _bootstrap
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))


class Imports:
    """Processor time that imports take; one that needs others imports them inside."""

    def __init__(self) -> None:
        self.seconds, self._depth = time.process_time(), 0
        # what every import of a module that is not there yet goes through
        self._find, _bootstrap._find_and_load = _bootstrap._find_and_load, self._timed

    def _timed(self, *arguments: object) -> object:
        begin, self._depth = time.process_time(), self._depth + 1
        try:
            return self._find(*arguments)
        finally:
            self._depth -= 1
            if not self._depth:
                self.seconds += time.process_time() - begin


def main(answer: Path) -> None:
    """What `python -m pipeline` does, all of its imports timed."""
    imports = Imports()
    import pipeline.__main__

    if pipeline.__main__.main() != 0:
        sys.exit(1)
    answer.write_text(repr(imports.seconds))


if __name__ == "__main__":
    main(Path(sys.argv.pop(1)))
