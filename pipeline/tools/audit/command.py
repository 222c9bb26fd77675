"""``python -m pipeline audit FOLDER [--json FILE]``: whether a run of what is committed gives what
is committed, to the bit.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from pipeline.core.errors import PipelineError
from pipeline.tools.audit.clone import changes, clone, commit, fetch_cached, rerun
from pipeline.tools.audit.listing import as_json, as_table
from pipeline.tools.audit.verdict import DIFFERENT, judge


def run(words: list[str]) -> None:
    """Run the last commit anew in FOLDER and print what differs. Raises PipelineError where that is
    more than the tolerance.
    """
    parser = argparse.ArgumentParser(
        prog="python -m pipeline audit", description=__doc__.partition(": ")[2]
    )
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER",
        help="where the commit is cloned to and run, and stays to be looked at",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="every difference, for programs")
    arguments = parser.parse_args(words)
    folder = arguments.folder.resolve()
    root = Path.cwd()
    print(f"audit: commit {commit(root)}", flush=True)
    if edited := changes(root):
        print(f"audit: not as committed, and left out: {', '.join(edited)}", flush=True)
    committed, again = clone(root, folder)
    audit = judge(committed, again, rerun(again), partial(fetch_cached, committed, root))
    if arguments.json:
        arguments.json.write_text(as_json(audit), encoding="utf-8")
    print(as_table(audit))
    if audit.verdict == DIFFERENT:
        raise PipelineError(
            "what is committed is not what its code gives; look at the outputs above in both "
            "clones",
            folder=folder,
        )
