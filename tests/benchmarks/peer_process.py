"""Calls into a library of the peers' environment, which cannot be imported here: a process, and a
line of JSON in each direction a call.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

INTERPRETER = Path(__file__).parents[2] / ".venv-peers/bin/python"
SERVER = Path(__file__).parent / "peers/serve.py"
# settings of our own arithmetic for the sake of equal bytes, from which a peer is free
OURS = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES")


class PeerProcess:
    """Context of a process with peers/NAME.py, whose ``setup(**options)`` returns what each call
    calls there; arrays are sent as lists. Raises RuntimeError with the peer's traceback.
    """

    def __init__(self, name: str, options: dict) -> None:
        environment = {key: value for key, value in os.environ.items() if key not in OURS}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._name = name
        self._process = subprocess.Popen([INTERPRETER, SERVER, name], env=environment, **pipes)
        try:
            self.configuration = self._ask(
                json.dumps(options, default=lambda array: array.tolist())
            )
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self) -> PeerProcess:
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()
        self._process.stdin.detach()  # a broken pipe cannot be flushed

    def __call__(self) -> object:
        return self._ask("")

    def _ask(self, line: str) -> object:
        try:
            print(line, file=self._process.stdin, flush=True)
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        answer = json.loads(answer or '{"error": "its process ended"}')
        if "error" in answer:
            raise RuntimeError(f"the peer {self._name} failed:\n{answer['error']}")
        return answer["value"]
