"""Calls into a library of the peers' environment, which cannot be imported here: a process, and a
line of JSON there and back a call.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np

INTERPRETER = Path(__file__).parents[2] / ".venv-peers/bin/python"
SERVER = Path(__file__).parent / "peers/serve.py"
# what our own arithmetic is held to for the sake of equal bits, and a peer is free of
HELD_TO_OUR_BITS = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES")


class PeerError(Exception):
    """A call in the peer's process failed; the message ends with the traceback over there."""


class PeerProcess:
    """peers/NAME.py, set up with ``options``; each call calls over there what its
    ``setup(**options)`` returned. ``configuration`` says in words how the peer is used.

    Options and values are what JSON holds, arrays go over as lists. Raises PeerError where either
    raises or the process ends. To be used in a with statement, at whose end the process ends.
    """

    def __init__(self, name: str, options: dict) -> None:
        environment = {
            name: value for name, value in os.environ.items() if name not in HELD_TO_OUR_BITS
        }
        self._name = name
        self._process = subprocess.Popen(
            [INTERPRETER, SERVER, name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        try:
            self.configuration = self._ask(json.dumps(options, default=np.ndarray.tolist))
        except BaseException:
            self._end()
            raise

    def __enter__(self) -> PeerProcess:
        return self

    def __exit__(self, *exception: object) -> None:
        self._end()

    def __call__(self) -> object:
        return self._ask("")

    def _ask(self, line: str) -> object:
        try:
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            raise PeerError(
                f"the process of the peer {self._name} ended with code {self._process.wait()}; "
                "its own words are above"
            )
        answer = json.loads(answer)
        if "error" in answer:
            raise PeerError(f"the peer {self._name} failed:\n{answer['error']}")
        return answer["value"]

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()
        # what a broken pipe left unwritten cannot be written any more
        self._process.stdin.detach()
